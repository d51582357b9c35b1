// The workspace measures for Python.
#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "workspace/workspace_batch.hpp"

namespace tensionlab {
namespace {

Poses poses_of(const In<3>& structure, const In<2>& lower, const In<2>& upper, double rank_tolerance) {
  const std::size_t size = structure.shape(0), m = structure.shape(2);
  require_size(structure.shape(1), m);
  require(has_shape(lower, size, m) && has_shape(upper, size, m), "limits do not fit the structure matrices");
  const Poses poses{structure.shape(0),
                    static_cast<int>(structure.shape(1)),
                    static_cast<int>(structure.shape(2)),
                    rows_of(structure),
                    rows_of(lower),
                    rows_of(upper),
                    rank_tolerance};
  return poses;
}

// Anchors, attachments and axes of pulleys (m, d), radii of pulleys (m), position (B, d), rotation (B, d, d).
nb::tuple matrices_at(const In<2>& anchors, const std::optional<In<2>>& attachments, const In<2>& position,
                      const std::optional<In<3>>& rotation, const std::optional<In<1>>& radii,
                      const std::optional<In<2>>& axes, double least_share) {
  const std::size_t size = position.shape(0), m = anchors.shape(0), d = anchors.shape(1);
  const std::size_t n = attachments ? 3 * (d - 1) : d;
  require(d == 2 || d == 3, "space has two or three dimensions");
  require_size(n, m);
  require(has_shape(position, size, d), "positions do not fit the anchors");
  require(!attachments || has_shape(*attachments, m, d), "attachments do not fit the anchors");
  require(!rotation || (attachments && has_shape(*rotation, size, d, d)), "rotations do not fit the positions");
  require(rows_of(anchors).stride == static_cast<std::int64_t>(d) || m < 2, "anchors must be contiguous");
  require(!attachments || rows_of(*attachments).stride == static_cast<std::int64_t>(d) || m < 2,
          "attachments must be contiguous");
  require(radii.has_value() == axes.has_value(), "pulleys have radii and axes");
  require(!radii || (radii->shape(0) == m && has_shape(*axes, m, d)), "pulleys do not fit the anchors");
  require(!axes || rows_of(*axes).stride == static_cast<std::int64_t>(d) || m < 2, "axes must be contiguous");
  const Cables cables{static_cast<int>(d),
                      static_cast<int>(m),
                      aligned(anchors),
                      attachments ? aligned(*attachments) : nullptr,
                      radii ? aligned(*radii) : nullptr,
                      axes ? aligned(*axes) : nullptr};
  const Rows turns = rotation ? rows_of(*rotation) : Rows{};
  const Places places{rows_of(position), rotation ? &turns : nullptr};
  const auto matrices = make_array<double>(size, n, m);
  const auto sound = make_array<bool>(size);
  const auto kernel = structure_matrices_for_this_processor();
  share_out(size, [&](std::size_t begin, std::size_t end) {
    kernel(cables, places, least_share, begin, end, {matrices.data(), sound.data()});
  });
  return nb::make_tuple(matrices, sound);
}

// Wrenches (B, any number, n).
Wrenches wrenches_of(const Poses& poses, const In<3>& wrenches) {
  require(has_shape(wrenches, poses.size, wrenches.shape(1), poses.n),
          "wrenches do not fit the structure matrices");
  return {rows_of(wrenches), static_cast<int>(wrenches.shape(1))};
}

// measure(begin, end, found) over all poses.
template <class Measure>
Out<double, 1> measured(const Poses& poses, const Measure& measure) {
  const auto found = make_array<double>(poses.size);
  share_out(poses.size, [&](std::size_t begin, std::size_t end) { measure(begin, end, found.data()); });
  return found;
}

Out<double, 1> margins(const In<3>& structure, const In<2>& lower, const In<2>& upper, const In<3>& wrenches,
                       double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  const Wrenches required = wrenches_of(poses, wrenches);
  const auto kernel = capacity_margin_for_this_processor();
  return measured(poses, [&](std::size_t begin, std::size_t end, double* margin) {
    kernel(poses, required, begin, end, margin);
  });
}

Out<double, 1> factors(const In<3>& structure, const In<2>& lower, const In<2>& upper, double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  const auto kernel = tension_factor_for_this_processor();
  return measured(poses,
                  [&](std::size_t begin, std::size_t end, double* factor) { kernel(poses, begin, end, factor); });
}

Out<double, 1> forces(const In<3>& structure, const In<2>& lower, const In<2>& upper, int dimension,
                      double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  require(dimension >= 1 && dimension <= poses.n, "no such dimension");
  const auto kernel = isotropic_force_for_this_processor();
  return measured(poses, [&](std::size_t begin, std::size_t end, double* force) {
    kernel(poses, dimension, begin, end, force);
  });
}

Out<double, 1> shares(const In<3>& structure, const In<2>& lower, const In<2>& upper, const In<3>& wrenches,
                      double tolerance, double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  const Wrenches wanted = wrenches_of(poses, wrenches);
  const auto kernel = reachable_share_for_this_processor();
  return measured(poses, [&](std::size_t begin, std::size_t end, double* share) {
    kernel(poses, wanted, tolerance, begin, end, share);
  });
}

nb::tuple active_facets(const In<3>& structure, const In<2>& lower, const In<2>& upper, const In<3>& wrenches,
                        double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  const Wrenches required = wrenches_of(poses, wrenches);
  const auto n = static_cast<std::size_t>(poses.n), m = static_cast<std::size_t>(poses.m);
  const auto margin = make_array<double>(poses.size);
  const auto normal = make_array<double>(poses.size, n);
  const auto number = make_array<std::int64_t>(poses.size);
  const auto tensions = make_array<double>(poses.size, m);
  const Active active{margin.data(), normal.data(), number.data(), tensions.data()};
  const auto kernel = active_facet_for_this_processor();
  share_out(poses.size, [&](std::size_t begin, std::size_t end) { kernel(poses, required, begin, end, active); });
  return nb::make_tuple(margin, normal, number, tensions);
}

nb::tuple all_half_spaces(const In<3>& structure, const In<2>& lower, const In<2>& upper, std::size_t capacity,
                          double rank_tolerance) {
  const Poses poses = poses_of(structure, lower, upper, rank_tolerance);
  const auto n = static_cast<std::size_t>(poses.n);
  const auto count = make_array<double>(poses.size);
  const auto normals = make_array<double>(poses.size, capacity * n);
  const auto offsets = make_array<double>(poses.size, capacity);
  const Facets facets{count.data(), normals.data(), offsets.data()};
  const auto kernel = half_spaces_for_this_processor();
  share_out(poses.size, [&](std::size_t begin, std::size_t end) { kernel(poses, capacity, begin, end, facets); });
  return nb::make_tuple(normals, offsets, count);
}

}  // namespace

void bind_workspace(nb::module_& module) {
  module.def("structure_matrices", &matrices_at, nb::arg("anchors"), nb::arg("attachments").none(),
             nb::arg("position"), nb::arg("rotation").none(), nb::arg("radii").none(), nb::arg("axes").none(),
             nb::arg("least_share"));
  module.def("capacity_margin", &margins);
  module.def("tension_factor", &factors);
  module.def("isotropic_force", &forces);
  module.def("reachable_share", &shares);
  module.def("active_facet", &active_facets);
  module.def("half_spaces", &all_half_spaces);
}

}  // namespace tensionlab
