// Structure matrices, workspace measures, clearances and proofs of cells for Python.
#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "workspace/kernels.hpp"
#include "workspace/segment_distance.hpp"

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

// Distances (B, k) of pairs (k, 2) of segments (B, S, 2, 3). The second of a pair is a box about its first end if
// it has half edges (S, 3) above zero; the axes of boxes (B, S, 3, 3) are columns.
Out<double, 2> segment_distances(const Contiguous<double, 4>& segments, const Contiguous<std::int64_t, 2>& pairs,
                                 const std::optional<Contiguous<double, 4>>& axes,
                                 const std::optional<Contiguous<double, 2>>& halves) {
  const std::size_t size = segments.shape(0), count = segments.shape(1), k = pairs.shape(0);
  require(has_shape(segments, size, count, 2, 3) && has_shape(pairs, k, 2) &&
              axes.has_value() == halves.has_value() &&
              (!axes || (has_shape(*axes, size, count, 3, 3) && has_shape(*halves, count, 3))),
          "segments (B, S, 2, 3), pairs (k, 2), axes (B, S, 3, 3) and half edges (S, 3) do not fit each other");
  const std::int64_t* const pair = aligned(pairs);
  for (std::size_t i = 0; i < 2 * k; ++i) {
    require(pair[i] >= 0 && pair[i] < static_cast<std::int64_t>(count), "a pair of no segments");
  }
  const double *const ends = aligned(segments), *const turns = axes ? aligned(*axes) : nullptr;
  const double* const half = halves ? aligned(*halves) : nullptr;
  const auto distance = make_array<double>(size, k);
  double* const found = distance.data();
  share_out(size, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      for (std::size_t p = 0; p < k; ++p) {
        const auto a = static_cast<std::size_t>(pair[2 * p]), b = static_cast<std::size_t>(pair[2 * p + 1]);
        const double *const one = ends + 6 * (count * row + a), *const other = ends + 6 * (count * row + b);
        found[k * row + p] =
            half && half[3 * b] > 0.0
                ? segment_box_distance(one, one + 3, {other, turns + 9 * (count * row + b), half + 3 * b})
                : segment_segment_distance(one, one + 3, other, other + 3);
      }
    }
  });
  return distance;
}

nb::tuple cells(const In<3>& anchors, const In<3>& arms, const In<1>& lower, const In<1>& upper,
                const In<3>& required, double radius, double slack, double angle, double length, bool closure,
                const std::optional<In<1>>& radii, const std::optional<In<2>>& axes, bool weight,
                const In<2>& centres, const In<1>& half_edges, bool with_shares) {
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
                         whole(axes),
                         weight};
  const double *const centre = whole(centres), *const half_edge = contiguous(half_edges);
  const auto verdict = make_array<std::int8_t>(size);
  Out<double, 2> shares;
  if (with_shares) shares = make_array<double>(size, 2);
  const CellVerdicts found{verdict.data(), with_shares ? shares.data() : nullptr};
  share_out(size,
            [&](std::size_t begin, std::size_t end) { certify_cells(rig, centre, half_edge, begin, end, found); });
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
  share_out(size, [&](std::size_t begin, std::size_t end) { pulley_bends(cables, begin, end, found.data()); });
  return found;
}

}  // namespace

void bind_workspace(nb::module_& module) {
  module.def("structure_matrices", &matrices_at, nb::arg("anchors"), nb::arg("attachments").none(),
             nb::arg("position"), nb::arg("rotation").none(), nb::arg("radii").none(), nb::arg("axes").none(),
             nb::arg("least_share"));
  module.def("capacity_margin", &margins);
  module.def("tension_factor", &factors);
  module.def("isotropic_force", &forces);
  module.def("feasible_direction_fraction", &fractions);
  module.def("active_facet", &active_facets);
  module.def("half_spaces", &all_half_spaces);
  module.def("segment_distances", &segment_distances, nb::arg("segments"), nb::arg("pairs"),
             nb::arg("axes").none(), nb::arg("halves").none());
  module.def("certify_cells", &cells, nb::arg("anchors"), nb::arg("arms"), nb::arg("lower"), nb::arg("upper"),
             nb::arg("required"), nb::arg("radius"), nb::arg("slack"), nb::arg("angle"), nb::arg("length"),
             nb::arg("closure"), nb::arg("radii").none(), nb::arg("axes").none(), nb::arg("weight"),
             nb::arg("centres"), nb::arg("half_edges"), nb::arg("with_shares"));
  module.def("pulley_bends", &bends);
}

}  // namespace tensionlab
