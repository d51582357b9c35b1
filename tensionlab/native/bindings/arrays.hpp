// NumPy arrays and bytes in and out of the kernels. The Python callers have checked entries and shapes; shapes are
// checked again here, because a kernel that reads beyond an array does so silently.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "tensionlab/simd/batch.hpp"

namespace nb = nanobind;

namespace tensionlab {

// Arrays of numbers, of any strides and contiguous.
template <int Axes>
using In = nb::ndarray<const double, nb::numpy, nb::ndim<Axes>, nb::device::cpu>;
template <class T, int Axes>
using Contiguous = nb::ndarray<const T, nb::numpy, nb::ndim<Axes>, nb::c_contig, nb::device::cpu>;
// Contiguous arrays that are changed in place.
template <int Axes>
using InOut = nb::ndarray<double, nb::ndim<Axes>, nb::c_contig, nb::device::cpu>;
// New arrays.
template <class T, int Axes>
using Out = nb::ndarray<T, nb::numpy, nb::ndim<Axes>>;

// A new array of these lengths, without values.
template <class T, class... Lengths>
Out<T, sizeof...(Lengths)> make_array(Lengths... lengths) {
  const std::size_t size = (std::size_t{1} * ... * static_cast<std::size_t>(lengths));
  T* const data = new T[size > 0 ? size : 1];
  const nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return Out<T, sizeof...(Lengths)>(data, {static_cast<std::size_t>(lengths)...}, owner);
}

inline Out<double, 1> to_array(const double* numbers, std::size_t size) {
  const auto array = make_array<double>(size);
  std::copy_n(numbers, size, array.data());
  return array;
}
inline Out<double, 1> to_array(const std::vector<double>& numbers) {
  return to_array(numbers.data(), numbers.size());
}

template <class Array>
std::vector<double> to_vector(const Array& array) {
  return {array.data(), array.data() + array.size()};
}

inline const std::uint8_t* bytes_of(const nb::bytes& content) {
  return reinterpret_cast<const std::uint8_t*>(content.c_str());
}
inline nb::bytes to_bytes(const std::uint8_t* bytes, std::size_t size) {
  return nb::bytes(reinterpret_cast<const char*>(bytes), size);
}

inline void require(bool right, const char* otherwise) {
  if (!right) throw std::invalid_argument(otherwise);
}

// Returns a code from Python as the enumerator of this number.
template <class Enum>
Enum to_enum(int code, Enum last, const char* otherwise) {
  require(code >= 0 && code <= static_cast<int>(last), otherwise);
  return static_cast<Enum>(code);
}
inline Policy to_policy(int code) { return to_enum(code, Policy::direction, "no such policy"); }
inline Rule to_rule(int code) { return to_enum(code, Rule::direction, "no such rule"); }

// Whether an array has these lengths.
template <class Array, class... Lengths>
bool has_shape(const Array& array, Lengths... lengths) {
  const std::size_t wanted[] = {static_cast<std::size_t>(lengths)...};
  return array.ndim() == sizeof...(lengths) && std::equal(wanted, wanted + array.ndim(), array.shape_ptr());
}

// Whether an array's numbers are at multiples of their size, unlike some views of a message's bytes.
template <class Array>
bool is_aligned(const Array& array) {
  return reinterpret_cast<std::uintptr_t>(array.data()) % sizeof(*array.data()) == 0;
}

// The numbers of an array, which must be aligned.
template <class Array>
auto* aligned(const Array& array) {
  require(is_aligned(array), "an array must be aligned; copy it first");
  return array.data();
}

// The numbers of a vector, which must be contiguous.
template <class Array>
const double* contiguous(const Array& vector) {
  require(vector.size() < 2 || vector.stride(0) == 1, "a vector must be contiguous; copy it first");
  return aligned(vector);
}

inline void require_size(std::size_t n, std::size_t m) {
  require(n >= 1 && n <= static_cast<std::size_t>(kMaxComponents) && m >= 1 &&
              m <= static_cast<std::size_t>(kMaxCables),
          "a problem has 1 to 6 wrench components and 1 to 32 cables");
}

template <class Array>
Rows rows_of(const Array& array) {
  std::size_t inner = 1;
  for (std::size_t axis = array.ndim(); axis-- > 1; inner *= array.shape(axis)) {
    if (array.shape(axis) > 1 && array.size() > 0 && array.stride(axis) != static_cast<std::int64_t>(inner)) {
      throw std::invalid_argument("only the first axis of an array may be strided; copy it first");
    }
  }
  return {aligned(array), array.stride(0)};
}

// Structure, wrench, lower, upper, reference and weights of a batch of problems, as Python has them.
using ProblemArrays = std::tuple<In<3>, In<2>, In<2>, In<2>, In<2>, In<1>>;

inline Batch batch_of(const ProblemArrays& arrays) {
  const auto& [structure, wrench, lower, upper, reference, weights] = arrays;
  const std::size_t size = structure.shape(0), n = structure.shape(1), m = structure.shape(2);
  require_size(n, m);
  require(has_shape(wrench, size, n) && has_shape(lower, size, m) && has_shape(upper, size, m) &&
              has_shape(reference, size, m) && has_shape(weights, n),
          "wrench, limits, reference and weights do not fit the structure matrices");
  return {size,           static_cast<int>(n), static_cast<int>(m), rows_of(structure), rows_of(wrench),
          rows_of(lower), rows_of(upper),      rows_of(reference),  contiguous(weights)};
}

}  // namespace tensionlab
