// The Python module tensionlab._native: arrays in, arrays out. Each function is called by the one Python module
// that owns its subject, which has checked shapes and entries.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <atomic>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "judge.hpp"
#include "newton_dispatch.hpp"

namespace nb = nanobind;
using namespace tensionlab;

namespace {

template <int Axes>
using In = nb::ndarray<const double, nb::numpy, nb::ndim<Axes>, nb::device::cpu>;
template <class T, int Axes>
using Out = nb::ndarray<T, nb::numpy, nb::ndim<Axes>>;

template <class T>
T* allocate(std::size_t count) {
  return new T[count > 0 ? count : 1];
}

template <class T>
nb::capsule owner(T* data) {
  return nb::capsule(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
}

template <class T>
Out<T, 1> vector_of(T* data, std::size_t rows) {
  return Out<T, 1>(data, {rows}, owner(data));
}
template <class T>
Out<T, 2> table_of(T* data, std::size_t rows, std::size_t columns) {
  return Out<T, 2>(data, {rows, columns}, owner(data));
}

template <class Array>
Rows rows_of(const Array& array) {
  return {array.data(), array.stride(0)};
}

Batch batch_of(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
               const In<2>& reference, const In<1>& weights) {
  Batch batch{structure.shape(0),
              static_cast<int>(structure.shape(1)),
              static_cast<int>(structure.shape(2)),
              rows_of(structure),
              rows_of(wrench),
              rows_of(lower),
              rows_of(upper),
              rows_of(reference),
              weights.data()};
  if (batch.n < 1 || batch.n > kMaxComponents || batch.m < 1 || batch.m > kMaxCables) {
    throw std::invalid_argument("at most 6 wrench components and 32 cables");
  }
  return batch;
}

nb::tuple newton(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                 const In<2>& reference, const In<1>& weights, int policy, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  const NewtonAnswer answer{allocate<double>(batch.size * m), allocate<double>(batch.size * n),
                            allocate<std::int64_t>(batch.size)};
  {
    nb::gil_scoped_release unlocked;
    share_out(batch.size, [&](std::size_t begin, std::size_t end) {
      newton_kernel().solve(batch, static_cast<Policy>(policy), rank_tolerance, begin, end, answer);
    });
  }
  return nb::make_tuple(table_of(answer.tensions, batch.size, m), vector_of(answer.iterations, batch.size),
                        table_of(answer.separation, batch.size, n));
}

// tensions and separation are changed in place.
nb::tuple judge(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                const In<1>& weights, nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> tensions,
                nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> separation, int rule,
                double tolerance, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  double* rendered = allocate<double>(batch.size * n);
  double* residual = allocate<double>(batch.size);
  double* scale = allocate<double>(batch.size);
  std::int8_t* status = allocate<std::int8_t>(batch.size);
  std::atomic<bool> flawed{false};
  {
    nb::gil_scoped_release unlocked;
    const Judge<kMaxComponents, kMaxCables> judge(batch.n, batch.m, batch.weights, static_cast<Rule>(rule),
                                                  tolerance, rank_tolerance);
    share_out(batch.size, [&](std::size_t begin, std::size_t end) {
      for (std::size_t row = begin; row < end; ++row) {
        const auto finding =
            judge.judge({batch.structure[row], batch.wrench[row], batch.lower[row], batch.upper[row]},
                        tensions.data() + row * m, rendered + row * n, separation.data() + row * n);
        status[row] = static_cast<std::int8_t>(finding.status);
        residual[row] = finding.residual;
        scale[row] = finding.scale;
        if (finding.status == Verdict::iteration_limit || finding.status == Verdict::failed) flawed = true;
      }
    });
  }
  return nb::make_tuple(table_of(rendered, batch.size, n), vector_of(residual, batch.size),
                        vector_of(status, batch.size), vector_of(scale, batch.size), flawed.load());
}

}  // namespace

NB_MODULE(_native, module) {
  module.attr("MAX_COMPONENTS") = kMaxComponents;
  module.attr("MAX_CABLES") = kMaxCables;
  module.def("newton", &newton);
  module.def("judge", &judge);
  module.def("instruction_set", [] { return std::string(newton_kernel().name); });
}
