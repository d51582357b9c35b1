// Problems of a batch through the lanes of a block: a lane that is done takes the next problem at once, so that
// hard problems never hold up easy ones.
#pragma once

#include <cstddef>

#include "simd/batch.hpp"
#include "simd/checkpoint.hpp"
#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// block: step() advances every lane, finished(l) tells whether lane l is done, park(l) lets it rest.
// load(l, row) gives lane l the problem of a row in [begin, end); store(l, row) takes its answer.
template <int L, class Block, class Load, class Store>
void refill(Block& block, std::size_t begin, std::size_t end, const Load& load, const Store& store) {
  std::size_t row[L], next = begin;
  int busy = 0;
  for (int l = 0; l < L; ++l) {
    row[l] = end;
    if (next == end) continue;
    load(l, next);
    row[l] = next++;
    ++busy;
  }
  for (unsigned steps = 1; busy > 0; ++steps) {
    if (steps % 1024 == 0) checkpoint();
    block.step();
    for (int l = 0; l < L; ++l) {
      if (row[l] == end || !block.finished(l)) continue;
      store(l, row[l]);
      if (next < end) {
        load(l, next);
        row[l] = next++;
      } else {
        row[l] = end;
        block.park(l);
        --busy;
      }
    }
  }
}

// The same for rows [begin, end) of a batch.
template <int L, class Block, class Store>
void refill(Block& block, const Batch& batch, std::size_t begin, std::size_t end, const Store& store) {
  refill<L>(
      block, begin, end,
      [&](int l, std::size_t row) {
        block.load(l, {batch.structure[row], batch.wrench[row], batch.lower[row], batch.upper[row],
                       batch.reference[row]});
      },
      store);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
