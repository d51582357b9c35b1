// A batch of problems as the Python side passes it, and the threads that share it out.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <thread>
#include <vector>

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

// TENSIONLAB_NUM_THREADS, or as many as the machine has.
inline unsigned thread_count() {
  if (const char* text = std::getenv("TENSIONLAB_NUM_THREADS")) {
    const long count = std::strtol(text, nullptr, 10);
    if (count > 0) return static_cast<unsigned>(std::min(count, 1024L));
  }
  return std::max(1U, std::thread::hardware_concurrency());
}

// work(begin, end) over [0, size), on threads when there is enough of it to pay for them.
template <class Work>
void share_out(std::size_t size, const Work& work) {
  constexpr std::size_t kWorthAThread = 1024;
  // Counting the processors costs more than a problem does, so ask only when it matters.
  const std::size_t worth = size / kWorthAThread;
  const std::size_t threads = worth < 2 ? 1 : std::min<std::size_t>(thread_count(), worth);
  if (threads < 2) {
    work(std::size_t{0}, size);
    return;
  }
  std::vector<std::thread> others;
  for (std::size_t t = 1; t < threads; ++t) {
    others.emplace_back([&, t] { work(size * t / threads, size * (t + 1) / threads); });
  }
  work(std::size_t{0}, size / threads);
  for (std::thread& other : others) other.join();
}

}  // namespace tensionlab
