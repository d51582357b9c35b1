// The distances between cables and bodies for Python.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "workspace/clearance_batch.hpp"

namespace tensionlab {
namespace {

nb::tuple closest_pair(const In<4>& segments, nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig> pairs,
                       const In<1>& radius) {
  const std::size_t size = segments.shape(0);
  const std::size_t count = segments.shape(1);
  require(count <= kMaxSegments && has_shape(segments, size, count, 2, 3) && has_shape(radius, count),
          "segments must be (B, at most 64, 2, 3), with one radius each");
  require(has_shape(pairs, pairs.shape(0), 2), "pairs must be (any number, 2)");
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    require(pairs.data()[i] >= 0 && pairs.data()[i] < static_cast<std::int64_t>(count), "a pair of no segments");
  }
  const Segments all{rows_of(segments), static_cast<int>(segments.shape(1)), static_cast<int>(pairs.shape(0)),
                     aligned(pairs), contiguous(radius)};
  const auto distance = make_array<double>(size);
  const auto closest = make_array<std::int64_t>(size);
  const auto clearance = clearance_for_this_processor();
  share_out(size, [&](std::size_t begin, std::size_t end) {
    clearance(all, begin, end, distance.data(), closest.data());
  });
  return nb::make_tuple(distance, closest);
}

}  // namespace

void bind_clearance(nb::module_& module) {
  module.attr("MAX_SEGMENTS") = kMaxSegments;
  module.def("closest_pair", &closest_pair);
}

}  // namespace tensionlab
