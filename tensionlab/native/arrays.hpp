// NumPy arrays in and out of the kernels. The Python callers have checked shapes and entries.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <stdexcept>

#include "batch.hpp"

namespace nb = nanobind;

namespace tensionlab {

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
  std::size_t inner = 1;
  for (std::size_t axis = array.ndim(); axis-- > 1; inner *= array.shape(axis)) {
    if (array.shape(axis) > 1 && array.size() > 0 && array.stride(axis) != static_cast<std::int64_t>(inner)) {
      throw std::invalid_argument("only the first axis of an array may be strided; copy it first");
    }
  }
  return {array.data(), array.stride(0)};
}

inline Batch batch_of(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
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

}  // namespace tensionlab
