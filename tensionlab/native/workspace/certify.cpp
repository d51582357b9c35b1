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
// Outside. One direction for which s(v) > h(v) suffices.
//
// In both, directions may move with the pose such that the cables that they are across stay so to first order
// (workspace/moving_direction.hpp): then the error of the bounds is quadratic in the cell's size. Moved rays still
// span cones that cover all directions: the map that is linear on cones (cut into simplices) and takes each ray to
// its moved one is the identity in the middle of the cell, and keeps its degree on the way to another pose as long
// as no direction is mapped to zero. None is while the bound is positive on all rays, since for some wrench of the
// set it is linear on a cone; nor while no ray moves by as much as it is long, in the norm sum of |v . w| over the
// cables that cut the cones, which is linear on them, too. The first condition holds for poses connected to the
// middle.
//
// Every bound is affine in the pose, so that it also gives the share of a cell that is proved. Rounding: a bound
// is a sum of some hundred terms, each within a few roundings of products that are at most `scale_`; 4096 units of
// that cover it.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "workspace/box_share.hpp"
#include "workspace/facet_rays.hpp"
#include "workspace/moving_direction.hpp"

namespace tensionlab {
namespace {

// value + slope . (dp, turn) + dp' C dp / 2, a bound for all poses of a cell; C row by row up to its diagonal.
template <int N, int D>
struct Bound {
  double value, slope[N], curve[D * (D + 1) / 2];

  template <class Pull>
  void add(double factor, const Pull& pull, int j) {
    value += factor * pull.value[j];
    for (int i = 0; i < N; ++i) slope[i] += factor * pull.slope[i][j];
    for (int i = 0; i < D * (D + 1) / 2; ++i) curve[i] += factor * pull.curve[i][j];
  }
};

template <int N, int D>
class CellProof {
 public:
  CellProof(const CertifiedRig& rig, std::size_t rotation, const double* centre, const double* half_edges,
            FacetRays<N>& rays)
      : rig_(rig),
        required_(rig.required + rotation * static_cast<std::size_t>(rig.wrenches * N)),
        columns_(rig, rotation, centre, half_edges),
        rays_(rays) {
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
    if (spans_) look_outside();
  }

  // A lower bound of the share of the cell that is outside: 1 only if all of it is.
  double outside() const {
    if (columns_.inside_pulley) return 1;
    if (!spans_) return 0;
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

  // The same for inside. Without `share` it is 1 or 0.
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
  double critical_[N];      // the ray with the least room in the middle
  std::uint32_t spanning_;  // the cables it is across
  bool violated_ = false;   // whether that room is negative
  double between_[N];       // if so, a direction between the rays with negative room

  static double dot(const double* a, const double* b) {
    double sum = 0;
    for (int k = 0; k < N; ++k) sum += a[k] * b[k];
    return sum;
  }
  static double size(const double* a) { return std::sqrt(dot(a, a)); }

  double pulled(const double* v, int j) const {
    double sum = 0;
    for (int k = 0; k < N; ++k) sum += v[k] * columns_.column[k][j];
    return sum;
  }

  // s(side v) without the radius, and the index of the wrench.
  double required(const double* v, double side, int& which) const {
    double most = -std::numeric_limits<double>::infinity();
    for (int k = 0; k < rig_.wrenches; ++k) {
      const double along = side * dot(v, required_ + k * N);
      if (along > most) {
        most = along;
        which = k;
      }
    }
    return most;
  }

  // Finds the directions in which the cell may be outside.
  void look_outside() {
    double least = std::numeric_limits<double>::infinity();
    bool sound = false;
    std::fill(between_, between_ + N, 0.0);
    for (const FacetRay<N>& ray : rays_.all()) {
      if (&ray - rays_.all().data() >= 1024) checkpoint();
      if (sound && !(ray.error < 1e-6)) continue;
      double along[M];
      for (int j = 0; j < rig_.m; ++j) along[j] = pulled(ray.v, j);
      for (const double side : {1.0, -1.0}) {
        const double room = to_spare(ray, along, side);
        for (int k = 0; k < N && room < 0; ++k) between_[k] -= room * side * ray.v[k];
        if (room < least || (!sound && ray.error < 1e-6)) {
          least = room;
          for (int k = 0; k < N; ++k) critical_[k] = side * ray.v[k];
          spanning_ = ray.spanning;
          sound = ray.error < 1e-6;
        }
      }
    }
    violated_ = least < 0;
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
        along[j] = pulled(between_, j);
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
      Bound<N, D> bound = to_spare(ray, direction, side);
      bound.value += dip(bound) - turn_reach(bound) - doubt(bound);
      if (bound.value > position_reach(bound)) continue;
      everywhere = false;
      if (missing == nullptr) continue;
      middle = middle && bound.value > 0;
      missing->add(bound.value, bound.slope);
    }
    return everywhere;
  }

  // A lower bound of the room along a ray on one side, with the tensions of the cones around it.
  Bound<N, D> to_spare(const FacetRay<N>& ray, const Direction& direction, double side) const {
    const auto& pull = direction.pull;
    Bound<N, D> bound{};
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
  double subtract_required(const Direction& direction, double side, Bound<N, D>& bound) const {
    int which = 0;
    const double most = required(direction.v, side, which);
    const double* const chosen = required_ + which * N;
    bound.value -= most;
    for (int i = 0; i < N; ++i) {
      bound.slope[i] -= side * dot(direction.mu[i], chosen) + rig_.radius * dot(direction.mu[i], direction.v);
    }
    // Another wrench may become the one that counts; and |v + mu| <= 1 + v . mu + mu . mu / 2.
    double more = 0;
    for (int k = 0; direction.longest > 0 && k < rig_.wrenches; ++k) {
      const double* const other = required_ + k * N;
      double beyond = side * dot(direction.v, other) - most;
      for (int i = 0; i < N; ++i) {
        beyond += columns_.edge(i) * std::abs(dot(direction.mu[i], other) - dot(direction.mu[i], chosen));
      }
      more = std::max(more, beyond);
    }
    return more + rig_.radius * (1 + direction.longest * direction.longest / 2) +
           (direction.torque() + direction.longest) * rig_.slack;
  }

  // A lower bound of the share in which a direction proves that a required wrench is not rendered.
  double beyond(const Direction& direction) const {
    return rig_.closure ? without_closure(direction) : beyond_reach(direction);
  }

  // The share in which an upper bound of the pull along v is less than required, in one turn: that suffices, since
  // the wrenches are required in all.
  double beyond_reach(const Direction& direction) const {
    const auto& pull = direction.pull;
    const double length = direction.length();
    Bound<N, D> bound{};
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
      bound.slope[i] -= dot(direction.mu[i], required_ + which * N);
      bound.slope[i] -= rig_.radius * dot(direction.mu[i], direction.v) / length;
    }
    bound.value += rise(bound) - turn_reach(bound) + doubt(bound);
    if (bound.value + position_reach(bound) < 0) return 1;
    return std::min(share_below<D>(bound.value, bound.slope, columns_.cell).low, kNotAll);
  }

  // The share in which no cable pulls along v, so that no tensions are in equilibrium, or all cables lie in a
  // plane.
  double without_closure(const Direction& direction) const {
    CoveredShare<D> pulled(columns_.cell);
    for (int j = 0; j < rig_.m; ++j) {
      Bound<N, D> bound{};
      bound.add(-1, direction.pull, j);
      bound.value -= direction.pull.error[j] + rounding_ * (direction.length() + direction.longest);
      bound.value += dip(bound) - turn_reach(bound) - doubt(bound);
      if (!(bound.value > position_reach(bound))) pulled.add(bound.value, bound.slope);
    }
    const double share = pulled.share();
    return share > 0 ? std::min(1 - share, kNotAll) : 1;
  }
  static constexpr double kNotAll = 1 - 1e-8;

  double dip(const Bound<N, D>& bound) const {
    return columns_.dip([&](int i) { return bound.curve[i]; });
  }
  double rise(const Bound<N, D>& bound) const {
    return -columns_.dip([&](int i) { return -bound.curve[i]; });
  }
  double position_reach(const Bound<N, D>& bound) const {
    double reach = 0;
    for (int i = 0; i < D; ++i) reach += std::abs(bound.slope[i]) * columns_.cell[i];
    return reach;
  }
  // The largest change of a bound by rounding of the position.
  double doubt(const Bound<N, D>& bound) const {
    double change = 0;
    for (int i = 0; i < D; ++i) change += std::abs(bound.slope[i]) * (columns_.half[i] - columns_.cell[i]);
    return change;
  }
  double turn_reach(const Bound<N, D>& bound) const {
    double square = 0;
    for (int i = D; i < N; ++i) square += bound.slope[i] * bound.slope[i];
    return columns_.angle * std::sqrt(square);
  }
};

template <int N, int D>
void certify(const CertifiedRig& rig, const double* centres, const double* half_edges, std::size_t begin,
             std::size_t end, const CellVerdicts& found) {
  FacetRays<N> rays;
  CertifiedRig still = rig;
  still.angle = still.slack = 0;
  for (std::size_t cell = begin; cell < end; ++cell) {
    double inside = 1, outside = 0;
    for (int rotation = 0; rotation < rig.rotations && outside < 1; ++rotation) {
      checkpoint();
      const auto at = static_cast<std::size_t>(rotation);
      if (rig.angle > 0) {  // one turn in which a pose is outside is enough, and least is lost in none
        outside = std::max(outside, CellProof<N, D>(still, at, centres + cell * D, half_edges, rays).outside());
      }
      const CellProof<N, D> proof(rig, at, centres + cell * D, half_edges, rays);
      outside = std::max(outside, proof.outside());
      if (outside < 1 && inside > 0) inside = std::max(0.0, inside - 1 + proof.inside(found.shares != nullptr));
    }
    if (outside >= 1) inside = 0;
    found.verdict[cell] = inside >= 1 ? 1 : outside >= 1 ? -1 : 0;
    if (found.shares != nullptr) {
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
