// Structure matrices, workspace measures, clearances and proofs of cells for Python.
#include <nanobind/stl/optional.h>

#include <limits>
#include <optional>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "workspace/box_distance.hpp"
#include "workspace/kernels.hpp"

namespace tensionlab {
namespace {

// All numbers of an array, which must be contiguous.
template <class Array>
const double* whole(const Array& array) {
  const Rows rows = rows_of(array);
  require(array.shape(0) < 2 ||
              rows.stride * static_cast<std::int64_t>(array.shape(0)) == static_cast<std::int64_t>(array.size()),
          "an array must be contiguous; copy it first");
  return rows.data;
}
template <class Array>
const double* whole(const std::optional<Array>& array) {
  return array ? whole(*array) : nullptr;
}

// Anchors, attachments and axes of pulleys (m, d), radii of pulleys (m), position (B, d), rotation (B, d, d).
nb::tuple matrices_at(const In<2>& anchors, const std::optional<In<2>>& attachments, const In<2>& position,
                      const std::optional<In<3>>& rotation, const std::optional<In<1>>& radii,
                      const std::optional<In<2>>& axes, double least_share) {
  const std::size_t size = position.shape(0), m = anchors.shape(0), d = anchors.shape(1);
  const std::size_t n = attachments ? 3 * (d - 1) : d;
  require(d == 2 || d == 3, "space has two or three dimensions");
  require_size(n, m);
  require(has_shape(position, size, d) && (!attachments || has_shape(*attachments, m, d)) &&
              (!rotation || (attachments && has_shape(*rotation, size, d, d))),
          "attachments, positions and rotations do not fit the anchors");
  require(radii.has_value() == axes.has_value() && (!radii || (has_shape(*radii, m) && has_shape(*axes, m, d))),
          "pulleys have radii and axes that fit the anchors");
  const CableGeometry cables{static_cast<int>(d), static_cast<int>(m), whole(anchors),
                             whole(attachments),  whole(radii),        whole(axes)};
  const Rows rotations = rotation ? rows_of(*rotation) : Rows{};
  const PoseRows poses{rows_of(position), rotation ? &rotations : nullptr};
  const auto structure = make_array<double>(size, n, m);
  const auto valid = make_array<bool>(size);
  const StructureAnswer answer{structure.data(), valid.data()};
  const auto kernel = structure_matrices_for_this_processor();
  share_out(size,
            [&](std::size_t begin, std::size_t end) { kernel(cables, poses, least_share, begin, end, answer); });
  return nb::make_tuple(structure, valid);
}

Poses poses_of(const In<3>& structure, const In<2>& lower, const In<2>& upper, double rank_tolerance) {
  const std::size_t size = structure.shape(0), n = structure.shape(1), m = structure.shape(2);
  require_size(n, m);
  require(has_shape(lower, size, m) && has_shape(upper, size, m), "limits do not fit the structure matrices");
  return {size,           static_cast<int>(n), static_cast<int>(m), rows_of(structure),
          rows_of(lower), rows_of(upper),      rank_tolerance};
}

// Wrenches (B, any number, n).
Wrenches wrenches_of(const Poses& poses, const In<3>& wrenches) {
  require(has_shape(wrenches, poses.size, wrenches.shape(1), poses.n),
          "wrenches do not fit the structure matrices");
  return {rows_of(wrenches), static_cast<int>(wrenches.shape(1))};
}

// One number for each pose, by a kernel and what it takes after the poses.
template <class Kernel, class... Options>
Out<double, 1> measure(Kernel kernel, const Poses& poses, const Options&... options) {
  const auto found = make_array<double>(poses.size);
  share_out(poses.size,
            [&](std::size_t begin, std::size_t end) { kernel(poses, options..., begin, end, found.data()); });
  return found;
}

Out<double, 1> margins(const In<3>& structure, const In<2>& lower, const In<2>& upper, const In<3>& wrenches,
                       double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  return measure(capacity_margin_for_this_processor(), poses, wrenches_of(poses, wrenches));
}

Out<double, 1> factors(const In<3>& structure, const In<2>& lower, const In<2>& upper, double rank_tolerance) {
  return measure(tension_factor_for_this_processor(), poses_of(structure, lower, upper, rank_tolerance));
}

Out<double, 1> forces(const In<3>& structure, const In<2>& lower, const In<2>& upper, int dimension,
                      double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  require(dimension >= 1 && dimension <= poses.n, "no such dimension");
  return measure(isotropic_force_for_this_processor(), poses, dimension);
}

Out<double, 1> fractions(const In<3>& structure, const In<2>& lower, const In<2>& upper, const In<3>& wrenches,
                         double tolerance, double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  return measure(feasible_direction_fraction_for_this_processor(), poses, wrenches_of(poses, wrenches), tolerance);
}

nb::tuple active_facets(const In<3>& structure, const In<2>& lower, const In<2>& upper, const In<3>& wrenches,
                        double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  const Wrenches required = wrenches_of(poses, wrenches);
  const auto margin = make_array<double>(poses.size);
  const auto normal = make_array<double>(poses.size, poses.n);
  const auto wrench = make_array<std::int64_t>(poses.size);
  const auto tensions = make_array<double>(poses.size, poses.m);
  const ActiveFacetAnswer answer{margin.data(), normal.data(), wrench.data(), tensions.data()};
  const auto kernel = active_facet_for_this_processor();
  share_out(poses.size, [&](std::size_t begin, std::size_t end) { kernel(poses, required, begin, end, answer); });
  return nb::make_tuple(margin, normal, wrench, tensions);
}

nb::tuple all_half_spaces(const In<3>& structure, const In<2>& lower, const In<2>& upper, std::size_t capacity,
                          double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  const auto count = make_array<double>(poses.size);
  const auto normals = make_array<double>(poses.size, capacity * static_cast<std::size_t>(poses.n));
  const auto offsets = make_array<double>(poses.size, capacity);
  const HalfSpaceAnswer answer{count.data(), normals.data(), offsets.data()};
  const auto kernel = half_spaces_for_this_processor();
  share_out(poses.size, [&](std::size_t begin, std::size_t end) { kernel(poses, capacity, begin, end, answer); });
  return nb::make_tuple(normals, offsets, count);
}

nb::tuple closest_pair(const In<4>& segments, const Contiguous<std::int64_t, 2>& pairs, const In<1>& radius) {
  const std::size_t size = segments.shape(0), count = segments.shape(1);
  require(count <= kMaxSegments && has_shape(segments, size, count, 2, 3) && has_shape(radius, count),
          "segments must be (B, at most 64, 2, 3), with one radius each");
  require(has_shape(pairs, pairs.shape(0), 2), "pairs must be (any number, 2)");
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    require(pairs.data()[i] >= 0 && pairs.data()[i] < static_cast<std::int64_t>(count), "a pair of no segments");
  }
  const Segments all{rows_of(segments), static_cast<int>(count), static_cast<int>(pairs.shape(0)), aligned(pairs),
                     contiguous(radius)};
  const auto distance = make_array<double>(size);
  const auto closest = make_array<std::int64_t>(size);
  const auto kernel = clearance_for_this_processor();
  share_out(size,
            [&](std::size_t begin, std::size_t end) { kernel(all, begin, end, distance.data(), closest.data()); });
  return nb::make_tuple(distance, closest);
}

// Distances (m, b) of straight cables from bodies, less radii, the least (m) of each cable, and the least of all
// above the margins. Cables: their directions are the first rows of the structure matrix (n, m), their ends at the
// platform (m, d), and their anchors (m, d), near which they end. Bodies: ends of segments (b, 2, 3), of a box
// twice its centre; axes (b, 3, 3) and half edges (b, 3) of boxes, zero for others; radii and margins (b).
nb::tuple body_distances(const Contiguous<double, 2>& structure, const Contiguous<double, 2>& ends,
                         const Contiguous<double, 2>& anchors, const Contiguous<double, 3>& segments,
                         const Contiguous<double, 3>& axes, const Contiguous<double, 2>& halves,
                         const In<1>& radii, const In<1>& margins) {
  const std::size_t m = ends.shape(0), d = ends.shape(1), bodies = halves.shape(0);
  require(d <= 3 && structure.shape(0) >= d && structure.shape(1) == m && has_shape(anchors, m, d) &&
              has_shape(segments, bodies, 2, 3) && has_shape(axes, bodies, 3, 3) && has_shape(halves, bodies, 3) &&
              has_shape(radii, bodies) && has_shape(margins, bodies),
          "arrays of cables (m) or bodies (b) do not belong together");
  const double *const radius = contiguous(radii), *const margin = contiguous(margins);
  const auto distance = make_array<double>(m, bodies);
  const auto nearest = make_array<double>(m);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < m; ++i) {
    double begin[3] = {}, end[3] = {}, length = 0.0;
    for (std::size_t k = 0; k < d; ++k) {
      begin[k] = aligned(ends)[d * i + k];
      length += (aligned(anchors)[d * i + k] - begin[k]) * aligned(structure)[m * k + i];
    }
    for (std::size_t k = 0; k < d; ++k) end[k] = begin[k] + length * aligned(structure)[m * k + i];
    nearest.data()[i] = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < bodies; ++j) {
      const double* const segment = aligned(segments) + 6 * j;
      const double* const half = aligned(halves) + 3 * j;
      const double found =
          (half[0] > 0.0 ? segment_box_distance(begin, end, {segment, aligned(axes) + 9 * j, half})
                         : segment_segment_distance(begin, end, segment, segment + 3)) -
          radius[j];
      distance.data()[bodies * i + j] = found;
      nearest.data()[i] = std::min(nearest.data()[i], found);
      least = std::min(least, found - margin[j]);
    }
  }
  return nb::make_tuple(distance, nearest, least);
}

// Distances (B) of segments (B, 2, 3) from a box about the origin with half edges (3).
Out<double, 1> box_distances(const Contiguous<double, 3>& segments, const In<1>& halves) {
  const std::size_t size = segments.shape(0);
  require(has_shape(segments, size, 2, 3) && has_shape(halves, 3), "segments must be (B, 2, 3), half edges (3)");
  const double *const ends = aligned(segments), *const half = contiguous(halves);
  const auto distance = make_array<double>(size);
  double* const found = distance.data();
  share_out(size, [&](std::size_t begin, std::size_t end) {
    const double centre[3] = {}, axes[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (std::size_t i = begin; i < end; ++i) {
      found[i] = segment_box_distance(ends + 6 * i, ends + 6 * i + 3, {centre, axes, half});
    }
  });
  return distance;
}

nb::tuple cells(const In<3>& anchors, const In<3>& arms, const In<1>& lower, const In<1>& upper,
                const In<3>& required, double radius, double slack, double angle, double length, bool closure,
                const std::optional<In<1>>& radii, const std::optional<In<2>>& axes, const In<2>& centres,
                const In<1>& half_edges, bool with_shares) {
  const std::size_t rotations = anchors.shape(0), m = anchors.shape(1), d = anchors.shape(2);
  const std::size_t n = required.shape(2), wrenches = required.shape(1), size = centres.shape(0);
  require_size(n, m);
  require((d == 2 && (n == 2 || n == 3)) || (d == 3 && (n == 3 || n == 6)),
          "no rig has this number of components");
  require(has_shape(arms, rotations, m, d) && has_shape(lower, m) && has_shape(upper, m) &&
              has_shape(required, rotations, wrenches, n) && wrenches > 0 && has_shape(centres, size, d) &&
              has_shape(half_edges, d),
          "arms, limits, wrenches and cells do not fit the anchors");
  require(radii.has_value() == axes.has_value() && (!radii || (has_shape(*radii, m) && has_shape(*axes, m, d))),
          "pulleys have radii and axes that fit the anchors");
  const CertifiedRig rig{static_cast<int>(n),
                         static_cast<int>(d),
                         static_cast<int>(m),
                         static_cast<int>(rotations),
                         static_cast<int>(wrenches),
                         whole(anchors),
                         whole(arms),
                         contiguous(lower),
                         contiguous(upper),
                         whole(required),
                         radius,
                         slack,
                         angle,
                         length,
                         closure,
                         whole(radii),
                         whole(axes)};
  const double *const centre = whole(centres), *const half_edge = contiguous(half_edges);
  const auto verdict = make_array<std::int8_t>(size);
  Out<double, 2> shares;
  if (with_shares) shares = make_array<double>(size, 2);
  const CellVerdicts found{verdict.data(), with_shares ? shares.data() : nullptr};
  const auto kernel = certify_cells_for_this_processor();
  share_out(size, [&](std::size_t begin, std::size_t end) { kernel(rig, centre, half_edge, begin, end, found); });
  return nb::make_tuple(verdict, with_shares ? nb::cast(shares) : nb::none());
}

// Vectors and axes (B, d), radii and distances (B): see `MovingCables`. Returns (B, d + d² + 3).
Out<double, 2> bends(const In<2>& vectors, const In<1>& radii, const In<2>& axes, const In<1>& moved) {
  const std::size_t size = vectors.shape(0), d = vectors.shape(1);
  require((d == 2 || d == 3) && has_shape(axes, size, d) && has_shape(radii, size) && has_shape(moved, size),
          "axes, radii and distances do not fit the vectors");
  const MovingCables cables{static_cast<int>(d), whole(vectors), contiguous(radii), whole(axes),
                            contiguous(moved)};
  const auto found = make_array<double>(size, d + d * d + 3);
  const auto kernel = pulley_bends_for_this_processor();
  share_out(size, [&](std::size_t begin, std::size_t end) { kernel(cables, begin, end, found.data()); });
  return found;
}

}  // namespace

void bind_workspace(nb::module_& module) {
  module.attr("MAX_SEGMENTS") = kMaxSegments;
  module.def("structure_matrices", &matrices_at, nb::arg("anchors"), nb::arg("attachments").none(),
             nb::arg("position"), nb::arg("rotation").none(), nb::arg("radii").none(), nb::arg("axes").none(),
             nb::arg("least_share"));
  module.def("capacity_margin", &margins);
  module.def("tension_factor", &factors);
  module.def("isotropic_force", &forces);
  module.def("feasible_direction_fraction", &fractions);
  module.def("active_facet", &active_facets);
  module.def("half_spaces", &all_half_spaces);
  module.def("closest_pair", &closest_pair);
  module.def("body_distances", &body_distances);
  module.def("box_distances", &box_distances);
  module.def("certify_cells", &cells, nb::arg("anchors"), nb::arg("arms"), nb::arg("lower"), nb::arg("upper"),
             nb::arg("required"), nb::arg("radius"), nb::arg("slack"), nb::arg("angle"), nb::arg("length"),
             nb::arg("closure"), nb::arg("radii").none(), nb::arg("axes").none(), nb::arg("centres"),
             nb::arg("half_edges"), nb::arg("with_shares"));
  module.def("pulley_bends", &bends);
}

}  // namespace tensionlab
