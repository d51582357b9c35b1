// The closest pair of segments, with one pose in each lane; compiled once for each instruction set
// (simd/instruction_set.hpp).
#include <limits>

#include "workspace/clearance.hpp"
#include "workspace/clearance_batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

void clearance(const Segments& all, std::size_t begin, std::size_t end, double* distance, std::int64_t* closest) {
  constexpr int L = TENSIONLAB_LANES;
  using V = Lanes<double, L>;
  for (std::size_t row = begin; row < end; row += L) {
    const double* poses[L];
    for (int l = 0; l < L; ++l) {  // past the end, the last pose again
      poses[l] = all.ends[std::min(row + static_cast<std::size_t>(l), end - 1)];
    }
    V number[kMaxSegments * 6];
    transpose<double, L>(poses, 6 * all.segments, [&](int i, const V& v) { number[i] = v; });
    const auto point = [&](int i) { return Point<V>{number[3 * i], number[3 * i + 1], number[3 * i + 2]}; };

    V least = V{} + std::numeric_limits<double>::infinity(), which = V{} - 1.0;
    for (int p = 0; p < all.pairs; ++p) {
      const int i = static_cast<int>(all.pair[2 * p]), j = static_cast<int>(all.pair[2 * p + 1]);
      const Point<V> a = point(2 * i), c = point(2 * j);
      const V squared = squared_distance<V>(a - c, point(2 * i + 1) - a, point(2 * j + 1) - c);
      const V apart = square_root<double, L>(squared) - (all.radius[i] + all.radius[j]);
      which = apart < least ? V{} + static_cast<double>(p) : which;
      least = smaller(apart, least);
    }
    for (int l = 0; l < L && row + static_cast<std::size_t>(l) < end; ++l) {
      distance[row + static_cast<std::size_t>(l)] = read<double>(least, l);
      closest[row + static_cast<std::size_t>(l)] = static_cast<std::int64_t>(read<double>(which, l));
    }
  }
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
