// The choice of brakes to lock for Python.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "hardware/lock_sets.hpp"

namespace tensionlab {
namespace {

template <int Axes>
using Flags = nb::ndarray<const bool, nb::numpy, nb::ndim<Axes>, nb::c_contig, nb::device::cpu>;
template <int Axes>
using Numbers = nb::ndarray<const double, nb::numpy, nb::ndim<Axes>, nb::c_contig, nb::device::cpu>;

nb::tuple choose_locks(const Numbers<3>& structure, const Numbers<2>& normal, const Numbers<1>& force,
                       const Flags<1>& pushing, const Flags<2>& held, const Numbers<1>& stiffness_ratio,
                       const Numbers<2>& limits, const Flags<1>& brake, double margin, int most, double price,
                       double hysteresis, double negligible, double rank_tolerance) {
  const std::size_t size = structure.shape(0), m = structure.shape(2);
  require_size(structure.shape(1), m);
  require(has_shape(normal, size, structure.shape(1)) && has_shape(force, size) && has_shape(pushing, size) &&
              has_shape(stiffness_ratio, size) && has_shape(held, size, m) && has_shape(limits, 3, m) &&
              has_shape(brake, m),
          "normals, forces, flags, limits and brakes do not fit the structure matrices");
  const double ones[kMaxComponents] = {1, 1, 1, 1, 1, 1};
  const Rows lower{limits.data(), 0}, upper{limits.data() + m, 0};
  const Batch motors{size,
                     static_cast<int>(structure.shape(1)),
                     static_cast<int>(m),
                     rows_of(structure),
                     rows_of(normal),
                     lower,
                     upper,
                     lower,
                     ones};
  const Walls walls{motors,      force.data(), stiffness_ratio.data(), limits.data() + 2 * m, pushing.data(),
                    held.data(), brake.data()};
  const LockRule rule{margin, most, price, hysteresis, negligible};
  const auto locked = make_array<bool>(size, m), available = make_array<bool>(size, m);
  const auto tensions = make_array<double>(size, m);
  const auto unresisted = make_array<double>(size);
  const LockAnswer answer{locked.data(), available.data(), tensions.data(), unresisted.data()};
  share_out(size, [&](std::size_t begin, std::size_t end) {
    LockSets sets(walls, rule, rank_tolerance, answer);
    for (std::size_t wall = begin; wall < end; ++wall) sets.choose(wall);
  });
  return nb::make_tuple(locked, tensions, unresisted, available);
}

}  // namespace

void bind_brakes(nb::module_& module) { module.def("choose_locks", &choose_locks); }

}  // namespace tensionlab
