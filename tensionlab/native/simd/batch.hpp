// A batch of problems as the Python side passes it.
#pragma once

#include <cstddef>

namespace tensionlab {

constexpr int kMaxComponents = 6;
constexpr int kMaxCables = 32;

// Rows of a (B, ...) array whose inner axes are contiguous; stride 0 repeats one row.
struct Rows {
  const double* data;
  std::ptrdiff_t stride;
#if defined(__GNUC__) || defined(__clang__)
  __attribute__((always_inline))  // see TENSIONLAB_BUILD in simd/lanes.hpp
#endif
  const double* operator[](std::size_t row) const {
    return data + static_cast<std::ptrdiff_t>(row) * stride;
  }
};

struct Batch {
  std::size_t size;
  int n, m;
  Rows structure, wrench, lower, upper, reference;
  const double* weights;
};

// Some rows of a batch: one after another from `first` on, or those of a list.
struct Selection {
  std::size_t first, count;
  const std::size_t* list = nullptr;
#if defined(__GNUC__) || defined(__clang__)
  __attribute__((always_inline))
#endif
  std::size_t operator[](std::size_t j) const {
    return list == nullptr ? first + j : list[j];
  }
};

}  // namespace tensionlab
