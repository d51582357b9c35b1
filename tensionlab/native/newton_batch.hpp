// The exact solver over a batch, compiled once for each instruction set (newton_*.cpp).
//
// A lane that is done takes the next problem at once, so that hard problems never hold up easy ones.
#pragma once

#include <cstdint>
#include <memory>

#include "batch.hpp"
#include "newton.hpp"

namespace tensionlab {

struct NewtonAnswer {
  double* tensions;
  double* separation;
  std::int64_t* iterations;
};

using NewtonSolve = void (*)(const Batch&, Policy, double rank_tolerance, std::size_t begin, std::size_t end,
                             const NewtonAnswer&);

inline namespace TENSIONLAB_BUILD {

template <int L, int N>
void newton_range(const Batch& batch, Policy policy, double rank_tolerance, std::size_t begin, std::size_t end,
                  const NewtonAnswer& answer) {
  using Block = Newton<double, L, N, kMaxCables>;
  double roots[N];
  for (int k = 0; k < N; ++k) roots[k] = std::sqrt(batch.weights[k]);
  Block block(batch.m, roots, policy, rank_tolerance);
  std::size_t row[L], next = begin;
  int busy = 0;
  const auto load = [&](int l) {
    block.load(l, {batch.structure[next], batch.wrench[next], batch.lower[next], batch.upper[next],
                   batch.reference[next]});
    row[l] = next++;
  };
  for (int l = 0; l < L; ++l) {
    row[l] = end;
    if (next < end) {
      load(l);
      ++busy;
    }
  }
  const auto m = static_cast<std::size_t>(batch.m);
  while (busy > 0) {
    block.step();
    for (int l = 0; l < L; ++l) {
      if (row[l] == end || !block.finished(l)) continue;
      answer.iterations[row[l]] = block.store(l, answer.tensions + row[l] * m, answer.separation + row[l] * N);
      if (next < end) {
        load(l);
      } else {
        row[l] = end;
        block.park(l);
        --busy;
      }
    }
  }
}

template <int L>
void newton_lanes(const Batch& batch, Policy policy, double rank_tolerance, std::size_t begin, std::size_t end,
                  const NewtonAnswer& answer) {
  static constexpr NewtonSolve kSolve[] = {newton_range<L, 1>, newton_range<L, 2>, newton_range<L, 3>,
                                           newton_range<L, 4>, newton_range<L, 5>, newton_range<L, 6>};
  kSolve[batch.n - 1](batch, policy, rank_tolerance, begin, end, answer);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
