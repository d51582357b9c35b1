// The proofs of cells of positions for Python.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "workspace/certify_batch.hpp"

namespace tensionlab {
namespace {

nb::tuple cells(const In<3>& anchors, const In<3>& arms, const In<1>& lower, const In<1>& upper,
                const In<3>& required, double radius, double slack, double angle, double length, bool closure,
                const In<2>& centres, const In<1>& half_edges, bool with_shares) {
  const std::size_t rotations = anchors.shape(0), m = anchors.shape(1), d = anchors.shape(2);
  const std::size_t n = required.shape(2), wrenches = required.shape(1), size = centres.shape(0);
  require_size(n, m);
  require((d == 2 && (n == 2 || n == 3)) || (d == 3 && (n == 3 || n == 6)), "no rig has so many components");
  require(has_shape(arms, rotations, m, d) && has_shape(lower, m) && has_shape(upper, m) &&
              has_shape(required, rotations, wrenches, n) && wrenches > 0 && has_shape(centres, size, d) &&
              has_shape(half_edges, d),
          "arms, limits, wrenches and cells do not fit the anchors");
  const auto whole = [](const auto& array) {
    const Rows rows = rows_of(array);
    require(array.shape(0) < 2 || rows.stride * static_cast<std::ptrdiff_t>(array.shape(0)) ==
                                      static_cast<std::ptrdiff_t>(array.size()),
            "an array must be contiguous; copy it first");
    return rows.data;
  };
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
                         closure};
  const double *const centre = whole(centres), *const half_edge = contiguous(half_edges);
  const auto verdict = make_array<std::int8_t>(size);
  Out<double, 2> shares;
  if (with_shares) shares = make_array<double>(size, 2);
  const CellVerdicts found{verdict.data(), with_shares ? shares.data() : nullptr};
  const auto kernel = certify_cells_for_this_processor();
  share_out(size, [&](std::size_t begin, std::size_t end) { kernel(rig, centre, half_edge, begin, end, found); });
  return nb::make_tuple(verdict, with_shares ? nb::cast(shares) : nb::none());
}

}  // namespace

void bind_certification(nb::module_& module) { module.def("certify_cells", &cells); }

}  // namespace tensionlab
