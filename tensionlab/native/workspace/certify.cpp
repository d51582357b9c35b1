// Whether all poses of a cell render every required wrench, or none does.
//
// The tensions render all required wrenches if h(v) >= s(v) in every direction v, where h(v) is the sum of the
// larger of lower v . w and upper v . w over all cables, and s(v) the largest component of a required wrench along
// v.
//
// Inside. Cut the directions into cones by the hyperplanes v . w = 0 of the cell's middle
// (workspace/facet_rays.hpp), and take for each cable the limit that pulls most in a cone, the lower one where it
// may run anywhere. With these tensions fixed, their pull along v minus s(v) is concave and homogeneous in v,
// whatever the pose: if it is not negative on the rays of the cone, it is not negative in the cone, and neither is
// h(v) - s(v). On a ray the cables that it is across may be at either limit, as in the cones around it, so the
// smaller of both is taken.
//
// Where orientations turn, one policy of tensions may do for all poses (workspace/tension_policy.hpp), and is
// tried before; the facets have to do for wrenches that one policy does not render.
//
// Outside. One direction for which s(v) > h(v) suffices, at one orientation: the given one, or the turn from it
// that lowers the least h(v) - s(v) in the middle most.
//
// In proofs by directions, these may move with the pose such that the cables that they are across stay so to first
// order (workspace/moving_direction.hpp): then the error of the bounds is quadratic in the cell's size. Moved rays
// still span cones that cover all directions: the map that is linear on cones (cut into simplices) and takes each
// ray to its moved one is the identity in the middle of the cell, and keeps its degree on the way to another pose
// as long as no direction is mapped to zero. None is while the bound is positive on all rays, since for some
// wrench of the set it is linear on a cone; nor while no ray moves by as much as it is long, in the norm sum of |v
// . w| over the cables that cut the cones, which is linear on them, too. The first condition holds for poses
// connected to the middle.
//
// Every bound becomes affine in the position (`CellBound`), so that it also gives the share of a cell that is
// proved. Rounding: a bound is a sum of some hundred terms, each within a few roundings of products that are at
// most `scale_`; 4096 units of that cover it.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "workspace/box_share.hpp"
#include "workspace/facet_rays.hpp"
#include "workspace/moving_direction.hpp"
#include "workspace/tension_policy.hpp"

namespace tensionlab {
namespace {

template <int N, int D>
class CellProof {
 public:
  CellProof(const CertifiedRig& rig, const double* centre, const double* half_edges, FacetRays<N>& rays)
      : rig_(rig), required_(rig.required), columns_(rig, centre, half_edges), rays_(rays) {
    scale_ = 0;
    for (int k = 0; k < rig.wrenches; ++k) scale_ = std::max(scale_, size(required_ + k * N));
    scale_ += rig.radius + rig.slack;
    for (int j = 0; j < rig.m; ++j) {
      scale_ += rig.upper[j] * columns_.largest[j];
      if (rig.lower[j] < rig.upper[j] && !columns_.anywhere(j)) loose_ |= 1u << j;
    }
    rounding_ = 4096 * std::numeric_limits<double>::epsilon() * scale_ + kTiny;
    rays_.find(columns_.column, rig.m, loose_);
    for (const FacetRay<N>& ray : rays_.all()) spans_ = spans_ || (loose_ & ~ray.across) != 0;
  }

  // A lower bound of the share of the cell that is outside: 1 only if all of it is.
  double outside() {
    if (columns_.inside_pulley) return 1;
    if (!spans_) return 0;
    look_outside();
    Direction critical(columns_, critical_);
    critical.straighten(spanning_);
    critical.follow(spanning_, 0, true);
    double best = beyond(critical);
    double leaning[N];
    if (best < 1 && critical.lean(spanning_, leaning)) {
      best = std::max(best, beyond(Direction(critical, leaning)));
    }
    if (best < 1 && violated_) best = std::max(best, beyond(Direction(columns_, between_)));
    return best;
  }

  // The same for inside, by one policy of tensions.
  double rendered() const {
    if (!spans_ || !columns_.clear_of_pulleys) return 0;
    return TensionPolicy<N, D>(rig_, columns_, rays_, loose_, rounding_).share();
  }

  // Finds the turn, by all of the angle, that raises what is required above the pull most; returns whether it may
  // be enough.
  bool worst_turn(double* turn) {
    if (!spans_) return false;
    look_outside();
    Direction critical(columns_, critical_);
    critical.follow(spanning_, 0, true);
    const CellBound<N, D> bound = pulls_beyond(critical);
    const double steepest = std::sqrt(dot<N - D>(bound.slope + D, bound.slope + D));
    for (int i = 0; i < N - D; ++i) turn[i] = -columns_.angle * (1 - 0x1p-20) * bound.slope[D + i] / steepest;
    return steepest > 0 && least_ < 2 * columns_.angle * steepest;  // the slope may double
  }

  // The same by facets. Without `share` it is 1 or 0.
  double inside(bool share) const {
    if (!spans_ || !columns_.clear_of_pulleys) return 0;
    bool middle = true, far = false;
    const auto all_rays = [&](bool may_move_far, CoveredShare<D>& missing) {
      for (const FacetRay<N>& ray : rays_.all()) {
        Direction direction(columns_, ray.v);
        checkpoint();
        if (spare_everywhere(ray, direction, nullptr, middle)) continue;
        const std::uint32_t counted = ray.error < kSure ? loose_ : 0;
        far = direction.follow(ray.spanning, counted, may_move_far) == Direction::Motion::far || far;
        if (!spare_everywhere(ray, direction, share ? &missing : nullptr, middle) && !share) return false;
      }
      return true;
    };
    CoveredShare<D> missing(columns_.cell);
    if (!all_rays(true, missing)) return 0;
    if (!far || middle) return 1 - missing.share();
    CoveredShare<D> missing_nearby(columns_.cell);
    all_rays(false, missing_nearby);
    return 1 - missing_nearby.share();
  }

 private:
  using Direction = MovingDirection<N, D>;
  static constexpr int M = kMaxCables;
  static constexpr double kSure = 0x1p-22;  // largest error of a ray that MovingDirection allows
  static constexpr double kTiny = 1e-290;   // below that, products lose digits

  const CertifiedRig& rig_;
  const double* required_;
  CellColumns<N, D> columns_;
  FacetRays<N>& rays_;
  std::uint32_t loose_ = 0;  // the cables that cut the cones
  bool spans_ = false;       // whether the columns span all wrenches
  double scale_, rounding_;
  double least_;            // room in the middle along any ray
  double critical_[N];      // the ray with that
  std::uint32_t spanning_;  // the cables it is across
  bool violated_ = false;   // whether that room is negative
  double between_[N];       // if so, a direction between the rays with negative room

  static double size(const double* a) { return std::sqrt(dot<N>(a, a)); }

  // s(side v) without the radius, and the index of the wrench.
  double required(const double* v, double side, int& which) const {
    double most = -std::numeric_limits<double>::infinity();
    for (int k = 0; k < rig_.wrenches; ++k) {
      const double along = side * dot<N>(v, required_ + k * N);
      if (along > most) {
        most = along;
        which = k;
      }
    }
    return most;
  }

  // Finds the directions in which the cell may be outside.
  void look_outside() {
    least_ = std::numeric_limits<double>::infinity();
    bool sound = false;
    std::fill(between_, between_ + N, 0.0);
    for (const FacetRay<N>& ray : rays_.all()) {
      if (&ray - rays_.all().data() >= 1024) checkpoint();
      if (sound && !(ray.error < 1e-6)) continue;
      double along[M];
      for (int j = 0; j < rig_.m; ++j) along[j] = columns_.pulled(ray.v, j);
      for (const double side : {1.0, -1.0}) {
        const double room = to_spare(ray, along, side);
        for (int k = 0; k < N && room < 0; ++k) between_[k] -= room * side * ray.v[k];
        if (room < least_ || (!sound && ray.error < 1e-6)) {
          least_ = room;
          for (int k = 0; k < N; ++k) critical_[k] = side * ray.v[k];
          spanning_ = ray.spanning;
          sound = ray.error < 1e-6;
        }
      }
    }
    violated_ = least_ < 0;
    if (!violated_) return;
    if (rig_.closure) away_from_columns();
    const double length = size(between_);
    for (double& each : between_) each /= length > 0 ? length : 1;
  }

  // h - s on a ray in the middle; for closure the largest pull of a cable along it.
  double to_spare(const FacetRay<N>& ray, const double* along, double side) const {
    double most = -std::numeric_limits<double>::infinity(), sum = -rig_.radius;
    for (int j = 0; j < rig_.m; ++j) {
      const double x = side * along[j];
      if (!(ray.across >> j & 1)) most = std::max(most, x);
      sum += x > 0 ? rig_.upper[j] * x : rig_.lower[j] * x;
    }
    int which = 0;
    return rig_.closure ? most : sum - required(ray.v, side, which);
  }

  // Moves between_ away from the point of the columns' convex hull nearest to zero, by the algorithm of Mitchell,
  // Demyanov and Malozemov (1974), which moves weight from the worst column to the best.
  void away_from_columns() {
    constexpr int kSteps = 100;
    double weight[M];
    std::fill(between_, between_ + N, 0.0);
    for (int j = 0; j < rig_.m; ++j) {
      weight[j] = 1.0 / rig_.m;
      for (int k = 0; k < N; ++k) between_[k] -= weight[j] * columns_.column[k][j];
    }
    for (int step = 0; step < kSteps; ++step) {
      int best = 0, worst = -1;
      double along[M];
      for (int j = 0; j < rig_.m; ++j) {
        along[j] = columns_.pulled(between_, j);
        if (along[j] > along[best]) best = j;
        if (weight[j] > 0 && (worst < 0 || along[j] < along[worst])) worst = j;
      }
      double square = 0;
      for (int k = 0; k < N; ++k) {
        const double apart = columns_.column[k][best] - columns_.column[k][worst];
        square += apart * apart;
      }
      if (!(square > 0)) return;
      const double moved = std::min(weight[worst], (along[best] - along[worst]) / square);
      weight[best] += moved;
      weight[worst] -= moved;
      for (int k = 0; k < N; ++k) {
        between_[k] -= moved * (columns_.column[k][best] - columns_.column[k][worst]);
      }
    }
  }

  // Whether the tensions of the cones around a ray are proved to render what is required in the whole cell, for
  // all turns. Adds the part where they may not to `missing`; clears `middle` if that contains the middle.
  bool spare_everywhere(const FacetRay<N>& ray, const Direction& direction, CoveredShare<D>* missing,
                        bool& middle) const {
    bool everywhere = true;
    for (const double side : {1.0, -1.0}) {
      CellBound<N, D> bound = to_spare(ray, direction, side);
      bound.settle();
      if (bound.value > bound.reach()) continue;
      everywhere = false;
      if (missing == nullptr) continue;
      middle = middle && bound.value > 0;
      missing->add(bound.value, bound.slope);
    }
    return everywhere;
  }

  // A lower bound of the room along a ray on one side, with the tensions of the cones around it.
  CellBound<N, D> to_spare(const FacetRay<N>& ray, const Direction& direction, double side) const {
    const auto& pull = direction.pull;
    CellBound<N, D> bound(columns_);
    double lost = (3 * ray.error * scale_ + rounding_) * (1 + direction.longest);
    for (int j = 0; j < rig_.m; ++j) {
      const double low = rig_.lower[j], high = rig_.upper[j];
      double tension;
      if (ray.across >> j & 1) {
        tension = (low + high) / 2;
        lost += (high - low) / 2 * (std::abs(pull.value[j]) + direction.reach(j)) + high * pull.error[j];
      } else {
        const bool pulls = ((ray.positive >> j & 1) != 0) == (side > 0);
        tension = pulls && !columns_.anywhere(j) ? high : low;
        lost += tension * pull.error[j];
      }
      bound.add(tension * side, pull, j);
    }
    if (!rig_.closure) lost += subtract_required(direction, side, bound);
    bound.value -= lost;
    return bound;
  }

  // Subtracts the affine part of s(side v) from a bound, and returns an upper bound of the rest.
  double subtract_required(const Direction& direction, double side, CellBound<N, D>& bound) const {
    int which = 0;
    const double most = required(direction.v, side, which);
    const double* const chosen = required_ + which * N;
    bound.value -= most;
    for (int i = 0; i < N; ++i) {
      bound.slope[i] -=
          side * dot<N>(direction.mu[i], chosen) + rig_.radius * dot<N>(direction.mu[i], direction.v);
    }
    // Another wrench may become the one that counts; and |v + mu| <= 1 + v . mu + mu . mu / 2.
    double more = 0;
    for (int k = 0; direction.longest > 0 && k < rig_.wrenches; ++k) {
      const double* const other = required_ + k * N;
      const double moved =
          columns_.reach([&](int i) { return dot<N>(direction.mu[i], other) - dot<N>(direction.mu[i], chosen); });
      more = std::max(more, side * dot<N>(direction.v, other) - most + moved);
    }
    return more + rig_.radius * (1 + direction.longest * direction.longest / 2) +
           (direction.torque() + direction.longest) * rig_.slack;
  }

  // A lower bound of the share in which a direction proves that a required wrench is not rendered.
  double beyond(const Direction& direction) const {
    return rig_.closure ? without_closure(direction) : beyond_reach(direction);
  }

  // An upper bound of the pull along v less what is required.
  CellBound<N, D> pulls_beyond(const Direction& direction) const {
    const auto& pull = direction.pull;
    const double length = direction.length();
    CellBound<N, D> bound(columns_);
    double excess = rounding_ * (length + direction.longest);
    excess += (direction.torque() + direction.longest) * rig_.slack;
    for (int j = 0; j < rig_.m; ++j) {
      const double low = rig_.lower[j], high = rig_.upper[j], x = pull.value[j];
      const double tension = x > 0 ? high : low;
      excess += tension * pull.error[j];
      // Where it crosses zero the other limit pulls more.
      excess += (high - low) * std::max(0.0, direction.reach(j) + pull.error[j] - std::abs(x));
      bound.add(tension, pull, j);
    }
    int which = 0;
    bound.value += excess - required(direction.v, 1, which) - rig_.radius * length;
    for (int i = 0; i < N; ++i) {
      bound.slope[i] -= dot<N>(direction.mu[i], required_ + which * N);
      bound.slope[i] -= rig_.radius * dot<N>(direction.mu[i], direction.v) / length;
    }
    return bound;
  }

  // The share in which that is negative: in one turn, since the wrenches are required in all.
  double beyond_reach(const Direction& direction) const {
    CellBound<N, D> bound = pulls_beyond(direction);
    bound.value += bound.bow(1) + bound.doubt();
    if (bound.value + bound.reach() < 0) return 1;
    return std::min(share_below<D>(bound.value, bound.slope, columns_.cell).low, kNotAll);
  }

  // The share in which no cable pulls along v, so that no tensions are in equilibrium, or all cables lie in a
  // plane.
  double without_closure(const Direction& direction) const {
    CoveredShare<D> pulled(columns_.cell);
    for (int j = 0; j < rig_.m; ++j) {
      CellBound<N, D> bound(columns_);
      bound.add(-1, direction.pull, j);
      bound.value -= direction.pull.error[j] + rounding_ * (direction.length() + direction.longest);
      bound.settle();
      if (!(bound.value > bound.reach())) pulled.add(bound.value, bound.slope);
    }
    const double share = pulled.share();
    return share > 0 ? std::min(1 - share, kNotAll) : 1;
  }
  static constexpr double kNotAll = 1 - 1e-8;
};

// Turns a vector, by Rodrigues' formula.
template <int N, int D>
void rotate(const double* turn, const double* x, double* out) {
  const double angle = std::sqrt(dot<N - D>(turn, turn));
  double once[D], twice[D];
  CellColumns<N, D>::cross(turn, x, once);
  CellColumns<N, D>::cross(turn, once, twice);
  for (int k = 0; k < D; ++k) {
    out[k] = x[k] + std::sin(angle) / angle * once[k] + (1 - std::cos(angle)) / (angle * angle) * twice[k];
  }
}

// Lower bounds of the shares of a cell that are inside and outside, for all turns of a rig.
template <int N, int D>
std::pair<double, double> prove(const CertifiedRig& rig, const double* centre, const double* half_edges,
                                bool shares, FacetRays<N> (&rays)[2]) {
  CellProof<N, D> proof(rig, centre, half_edges, rays[0]);
  if (N == D || !(rig.angle > 0)) {
    const double outside = proof.outside();
    return {outside < 1 ? proof.inside(shares) : 0, outside};
  }
  double turn[N], arms[kMaxCables][D];
  const double rendered = proof.rendered();
  if (rendered >= 1) return {1, 0};
  CertifiedRig still = rig;  // one turn in which a pose is outside is enough
  still.angle = still.slack = 0;
  double outside = CellProof<N, D>(still, centre, half_edges, rays[1]).outside();
  if (outside < 1 && proof.worst_turn(turn)) {
    for (int j = 0; j < rig.m; ++j) rotate<N, D>(turn, rig.arms + j * D, arms[j]);
    still.arms = arms[0];
    still.slack = rig.slack;
    outside = std::max(outside, CellProof<N, D>(still, centre, half_edges, rays[1]).outside());
  }
  return {outside < 1 ? std::max(rendered, proof.inside(shares)) : 0, outside};
}

template <int N, int D>
void certify(const CertifiedRig& rig, const double* centres, const double* half_edges, std::size_t begin,
             std::size_t end, const CellVerdicts& found) {
  FacetRays<N> rays[2];
  const bool shares = found.shares != nullptr;
  for (std::size_t cell = begin; cell < end; ++cell) {
    const double* const centre = centres + cell * D;
    double inside = 1, outside = 0;
    for (int rotation = 0; rotation < rig.rotations && outside < 1; ++rotation) {
      checkpoint();
      CertifiedRig here = rig;
      here.anchors += rotation * rig.m * D;
      here.arms += rotation * rig.m * D;
      here.required += rotation * rig.wrenches * N;
      const auto [proved, missing] = prove<N, D>(here, centre, half_edges, shares && inside > 0, rays);
      outside = std::max(outside, missing);
      inside = std::max(0.0, inside - 1 + proved);
    }
    if (outside >= 1) inside = 0;
    found.verdict[cell] = inside >= 1 ? 1 : outside >= 1 ? -1 : 0;
    if (shares) {
      found.shares[2 * cell] = inside;
      found.shares[2 * cell + 1] = outside;
    }
  }
}

template <int D>
void write_bends(const MovingCables& cables, std::size_t begin, std::size_t end, double* found) {
  constexpr int kNumbers = D + D * D + 3;
  for (std::size_t row = begin; row < end; ++row) {
    const PulleyBend<D> bend(cables.vectors + row * D, cables.radii[row], cables.axes + row * D,
                             cables.moved[row]);
    double* next = std::copy(bend.u, bend.u + D, found + row * kNumbers);
    next = std::copy(&bend.gradient[0][0], &bend.gradient[0][0] + D * D, next);
    *next++ = bend.smooth ? 1 : 0;
    *next++ = bend.smooth ? bend.steepest : 0;
    *next = bend.smooth ? bend.second : 0;
  }
}

}  // namespace

void certify_cells(const CertifiedRig& rig, const double* centres, const double* half_edges, std::size_t begin,
                   std::size_t end, const CellVerdicts& found) {
  if (rig.d == 2) {
    (rig.n == 2 ? certify<2, 2> : certify<3, 2>)(rig, centres, half_edges, begin, end, found);
  } else {
    (rig.n == 3 ? certify<3, 3> : certify<6, 3>)(rig, centres, half_edges, begin, end, found);
  }
}

void pulley_bends(const MovingCables& cables, std::size_t begin, std::size_t end, double* found) {
  (cables.d == 2 ? write_bends<2> : write_bends<3>)(cables, begin, end, found);
}

}  // namespace tensionlab
