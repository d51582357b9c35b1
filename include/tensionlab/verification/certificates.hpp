// Certificates: the proof behind every status, whichever solver gave the answer.
//
// The tensions are clipped into their limits, the wrench is recomputed, and a verdict needs a certificate:
//   EXACT    the error |w - W t|, with its rounding error, is within tolerance, whatever the weights;
//   NEAREST  a direction d with d'w > h(d) = sum_i max(d'W_i a_i, d'W_i b_i) separates w from every feasible
//   wrench,
//            and weak duality bounds the policy's best value to within tolerance of the answer's.
//
// In a precision of Real; every verdict allows for the rounding errors of its own sums, so that it holds for the
// numbers as given.
#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>

#include "tensionlab/simd/lanes.hpp"
#include "tensionlab/simd/linear.hpp"
#include "tensionlab/solvers/scale_search.hpp"

namespace tensionlab {

inline namespace TENSIONLAB_BUILD {

// L numbers at a time.
template <class Real, int L, int N, int M>
class Verifier {
 public:
  struct Finding {
    Status status;
    Real residual, scale;
  };

  Verifier(int m, const Real* weights, Rule rule, Real tolerance, Real rank_tolerance)
      : m_(m), weights_(weights), rule_(rule), tolerance_(tolerance), rank_tolerance_(rank_tolerance) {
    for (int k = 0; k < N; ++k) {
      roots_[k] = std::sqrt(weights[k]);
      lighter_[k] = 1 / roots_[k];
    }
  }

  // tensions (m): clipped in place. rendered (n): out. separation (n): a proposal in, the proof or zeros out.
  Finding verify(const Problem<Real>& problem, Real* tensions, Real* rendered, Real* separation) const {
    if (!clip(problem, tensions)) return fail(tensions, rendered, separation);
    Real error[N], error_square = 0, rendered_square = 0, heaviest = 0, sizes = 0;
    for (int k = 0; k < N; ++k) {
      Real size = std::abs(problem.wrench[k]);
      rendered[k] = product(problem.structure + k * m_, tensions, &size);
      error[k] = problem.wrench[k] - rendered[k];
      sizes += size * size;
    }
    const Real desired = dot<N>(problem.wrench, problem.wrench),
               allowed = tolerance_ * std::sqrt(larger(Real(1), desired));
    // Sums of m products, each rounded by half of epsilon at most, times two.
    const Real unit = Real(m_ + 1) * std::numeric_limits<Real>::epsilon();
    Real rounding = unit * std::sqrt(sizes);
    if (rounding > Real(1e-3) * allowed) {
      for (int k = 0; k < N; ++k)
        error[k] = precise_error(problem.structure + k * m_, tensions, problem.wrench[k]);
      rounding *= unit;
    }
    for (int k = 0; k < N; ++k) {
      error_square += weights_[k] * error[k] * error[k];
      rendered_square += weights_[k] * rendered[k] * rendered[k];
      heaviest = larger(heaviest, weights_[k]);
    }
    Finding finding{Status::unproven, std::sqrt(error_square), std::numeric_limits<Real>::quiet_NaN()};
    // Weights choose among errors; they make none vanish.
    if (std::sqrt(dot<N>(error, error)) + rounding <= allowed) {
      for (int k = 0; k < N; ++k) separation[k] = 0;
      finding.status = Status::exact;
      finding.scale = 1;
      return finding;
    }
    // Relative to the rendered wrench: a desired one that is far from feasible would excuse any error.
    const Real tolerance = tolerance_ * std::sqrt(larger(heaviest, rendered_square));
    for (int k = 0; k < N; ++k) {
      if (!std::isfinite(separation[k])) separation[k] = 0;
    }
    bool proved = false;
    if (rule_ == Rule::force) proved = nearest_force(problem, tensions, error, tolerance, separation);
    if (rule_ == Rule::tension) proved = nearest_tension(problem, tensions, error, separation);
    if (rule_ == Rule::direction)
      proved = longest(problem, tensions, rendered, error, tolerance, separation, &finding);
    if (!proved) {
      for (int k = 0; k < N; ++k) separation[k] = 0;
    }
    if (proved) finding.status = Status::nearest;
    return finding;
  }

 private:
  using V = Lanes<Real, L>;

  // Clips the tensions into their limits; returns false if one is not finite.
  bool clip(const Problem<Real>& problem, Real* tensions) const {
    V invalid = {};
    int i = 0;
    for (; i + L <= m_; i += L) {
      const V tension = load<Real, L>(tensions + i);
      invalid += tension - tension;  // not zero where infinite or NaN
      store(smaller(larger(tension, load<Real, L>(problem.lower + i)), load<Real, L>(problem.upper + i)),
            tensions + i);
    }
    bool clean = !any(!(invalid == V{}));
    for (; i < m_; ++i) {
      clean = clean && std::isfinite(tensions[i]);
      tensions[i] = smaller(larger(tensions[i], problem.lower[i]), problem.upper[i]);
    }
    return clean;
  }

  // Adds up numbers of all cables: visit(zero, i, sums) adds those of the cables in lanes from i on, or of one.
  template <int K, class Visit>
  void sum_up(Real (&sums)[K], const Visit& visit) const {
    V lanes[K] = {};
    int i = 0;
    for (; i + L <= m_; i += L) visit(V{}, i, lanes);
    for (int k = 0; k < K; ++k) {
      for (int l = 0; l < L; ++l) sums[k] += read<Real>(lanes[k], l);
    }
    for (; i < m_; ++i) visit(Real(0), i, sums);
  }

  // Numbers of a row that belong to those of `zero`.
  template <class T>
  static T at(const Real* row, int i, const T&) {
    return load<Real, sizeof(T) / sizeof(Real)>(row + i);
  }

  // row . tensions; adds the magnitudes of the products to the size.
  Real product(const Real* row, const Real* tensions, Real* size) const {
    Real sums[2] = {0, *size};
    sum_up(sums, [&](const auto& zero, int i, auto& sum) {
      const auto part = at(row, i, zero) * at(tensions, i, zero);
      sum[0] += part;
      sum[1] += magnitude(part);
    });
    *size = sums[1];
    return sums[0];
  }

  // w - row . t in twice the precision (Ogita, Rump, Oishi, "Accurate sum and dot product", 2005).
  Real precise_error(const Real* row, const Real* tensions, Real wrench) const {
    Real sum = wrench, rest = 0;
    for (int i = 0; i < m_; ++i) {
      const volatile Real product = -row[i] * tensions[i];  // not fused with the sum
      const Real part = product, whole = sum + part, added = whole - sum;
      rest += std::fma(-row[i], tensions[i], -part) + ((sum - (whole - added)) + (part - added));
      sum = whole;
    }
    return sum + rest;
  }

  Finding fail(Real* tensions, Real* rendered, Real* separation) const {
    const Real nan = std::numeric_limits<Real>::quiet_NaN();
    for (int i = 0; i < m_; ++i) tensions[i] = nan;
    for (int k = 0; k < N; ++k) {
      rendered[k] = nan;
      separation[k] = 0;
    }
    return {Status::failed, nan, nan};
  }

  // d'w, h(d), the rounding error of either, and h(d) - d'W t.
  struct Side {
    Real wrench, support, rounding, gap;
    bool separates() const { return wrench - support > rounding; }
  };

  Side side(const Problem<Real>& problem, const Real* tensions, const Real* d) const {
    Side s{0, 0, 0, 0};
    for (int k = 0; k < N; ++k) {
      s.wrench += d[k] * problem.wrench[k];
      s.rounding += std::abs(d[k] * problem.wrench[k]);
    }
    Real sums[3] = {0, 0, s.rounding};
    sum_up(sums, [&](const auto& zero, int i, auto& sum) {
      auto along = zero, size = zero;
      for (int k = 0; k < N; ++k) {
        const auto part = d[k] * at(problem.structure + k * m_, i, zero);
        along += part;
        size += magnitude(part);
      }
      const auto lower = at(problem.lower, i, zero), upper = at(problem.upper, i, zero);
      const auto end = along > zero ? upper : lower;
      sum[0] += along * end;
      sum[1] += along * (end - at(tensions, i, zero));
      sum[2] += size * larger(magnitude(lower), magnitude(upper));
    });
    s.support = sums[0];
    s.gap = sums[1];
    s.rounding = sums[2];
    // A product of three numbers and sums of N and m of them, each rounded by half of epsilon at most, twice over.
    s.rounding *= Real(N + m_ + 3) * std::numeric_limits<Real>::epsilon();
    return s;
  }

  // Any d bounds the least error from below: |Q^(1/2) (w - W t)| >= (d'w - h(d)) / |Q^(-1/2) d|. Tries the
  // proposal, Q r without its part in the span of the free cables, and Q r itself; d becomes the one that proves
  // it.
  bool nearest_force(const Problem<Real>& problem, const Real* tensions, const Real* error, Real tolerance,
                     Real* d) const {
    Real unit[N];
    for (int k = 0; k < N; ++k) unit[k] = roots_[k] * error[k];
    const Real residual = scale_to_unit(unit);
    const auto proves = [&]() {
      Real dual[N];
      for (int k = 0; k < N; ++k) dual[k] = d[k] * lighter_[k];
      const Real length = scale_to_unit(dual);
      const Side s = side(problem, tensions, d);
      return s.separates() && residual * spread(unit, dual) + s.gap / length <= tolerance;
    };
    if (proves()) return true;
    for (int k = 0; k < N; ++k) d[k] = weights_[k] * error[k];
    remove_free(problem, tensions, d);
    if (proves()) return true;
    for (int k = 0; k < N; ++k) d[k] = weights_[k] * error[k];
    return proves();
  }

  // The residual minus its lower bound is |r| (1 - cos) + (h(d) - d'W t) / |d|. Both terms are sums of nonnegative
  // numbers, so that nothing cancels, however far w is from feasible.
  Real spread(const Real* unit, const Real* dual) const {
    Real square = 0;
    for (int k = 0; k < N; ++k) square += (unit[k] - dual[k]) * (unit[k] - dual[k]);
    return square / 2;
  }

  Real scale_to_unit(Real* x) const {
    const Real length = std::sqrt(dot<N>(x, x)), inverse = length > 0 ? 1 / length : 0;
    for (int k = 0; k < N; ++k) x[k] *= inverse;
    return length;
  }

  // Subtracts from d its part in the span of the free cables. At an optimum it is rounding alone, which large
  // limits would magnify.
  void remove_free(const Problem<Real>& problem, const Real* tensions, Real* d) const {
    constexpr Real kInside = Real(1e-6), kNew = Real(1e-8);
    OrthogonalColumns<Real, N> span;
    Real play = 0, column[N], unused[N] = {};
    for (int i = 0; i < m_; ++i) play = larger(play, kInside * std::abs(tensions[i]));
    for (int i = 0; i < m_ && span.count < N; ++i) {
      if (!(tensions[i] - problem.lower[i] > play && problem.upper[i] - tensions[i] > play)) continue;
      for (int k = 0; k < N; ++k) column[k] = problem.structure[k * m_ + i];
      span.add(column, kNew);
    }
    span.take_out(d, unused);
    span.take_out(d, unused);
  }

  void subtract(const Real* x, Real factor, Real* from) const {
    for (int k = 0; k < N; ++k) from[k] -= factor * x[k];
  }

  // In the metric (W W')^+ the length of an error r in the range of W is |B r|, and the bound for a d in that
  // range is |B (w - W t)| >= (d'w - h(d)) / |W'd|. Tries the proposal, and B'B r as above.
  bool nearest_tension(const Problem<Real>& problem, const Real* tensions, const Real* error, Real* d) const {
    Real columns[N * M];
    for (int i = 0; i < m_; ++i) {
      for (int k = 0; k < N; ++k) columns[i * N + k] = problem.structure[k * m_ + i];
    }
    const Whitening<Real, N, M> whitening(problem.structure, N, m_, rank_tolerance_);
    Real own[N] = {}, proposal[N] = {}, unit[N] = {}, outside[N] = {}, rendered = 0;
    for (int j = 0; j < whitening.rank; ++j) {
      const Real* row = whitening.rows[j];
      unit[j] = dot<N>(row, error);
      const Real part = dot<N>(row, problem.wrench) - unit[j];
      for (int k = 0; k < N; ++k) own[k] += row[k] * unit[j];
      rendered += part * part;
    }
    project(whitening, d, proposal);
    project(whitening, problem.wrench, outside);
    for (int k = 0; k < N; ++k) outside[k] = problem.wrench[k] - outside[k];
    const Real size = scale_to_unit(unit);
    const Real tolerance = tolerance_ * larger(Real(1), std::sqrt(rendered));
    if (size <= tolerance) {
      // The part of w in the range of W is rendered; the rest separates.
      for (int k = 0; k < N; ++k) d[k] = outside[k];
      if (side(problem, tensions, d).separates()) return true;
    }
    Real clean[N];
    for (int k = 0; k < N; ++k) clean[k] = own[k];
    remove_free(problem, tensions, clean);
    for (const Real* candidate : {proposal, clean, own}) {
      Real image[N] = {}, dual[N] = {};  // W W'd, and B of it, whose length is |W'd|
      for (int i = 0; i < m_; ++i) {
        const Real along = dot<N>(candidate, columns + i * N);
        for (int k = 0; k < N; ++k) image[k] += along * columns[i * N + k];
      }
      for (int j = 0; j < whitening.rank; ++j) dual[j] = dot<N>(whitening.rows[j], image);
      const Real length = scale_to_unit(dual);
      for (int k = 0; k < N; ++k) d[k] = candidate[k];
      const Side s = side(problem, tensions, d);
      if (s.separates() && size * spread(unit, dual) + s.gap / length <= tolerance) return true;
    }
    return false;
  }

  // The part of x in the range of W. The rows of B are orthogonal where they do not span all.
  void project(const Whitening<Real, N, M>& whitening, const Real* x, Real* part) const {
    for (int k = 0; k < N; ++k) part[k] = whitening.rank == N ? x[k] : 0;
    if (whitening.rank == N) return;
    for (int j = 0; j < whitening.rank; ++j) {
      const Real* row = whitening.rows[j];
      const Real along = dot<N>(row, x) / dot<N>(row, row);
      for (int k = 0; k < N; ++k) part[k] += row[k] * along;
    }
  }

  // s w is infeasible for every s above the bound of d, which is exact unless w grazes the face of d
  // (tensionlab/solvers/scale_search.hpp). Weights do not matter, as the direction is kept.
  bool longest(const Problem<Real>& problem, const Real* tensions, const Real* rendered, const Real* error,
               Real tolerance, Real* d, Finding* finding) const {
    const Side s = side(problem, tensions, d);
    if (!s.separates()) return false;
    const Real unit = 1 / std::sqrt(dot<N>(d, d)), length = std::sqrt(dot<N>(problem.wrench, problem.wrench));
    const Real allowed = direction_tolerance(tolerance_, length, wrench_bound<N>(problem, m_));
    const ScaleLine<Real> line{s.wrench * unit, s.support * unit};
    if (ScaleLine<Real>{line.along, line.reach + s.rounding * unit}.moved(allowed).excludes_all()) {
      Real force[N] = {};
      return nearest_force(problem, tensions, error, tolerance, force);
    }
    constexpr Real kEnough = Real(0.98);  // of what is allowed
    const auto most = line.moved_as_allowed(kEnough * allowed, length);
    if (!(most.along > 0)) return false;
    const Real scale = dot<N>(rendered, problem.wrench) / (length * length);
    Real missing[N];
    for (int k = 0; k < N; ++k) missing[k] = scale * problem.wrench[k] - rendered[k];
    const Real off = std::sqrt(dot<N>(missing, missing));
    const Real near = tolerance_ * larger(Real(1), std::sqrt(dot<N>(rendered, rendered)));
    if (off > (most.reach > line.reach ? larger(near, allowed) : near)) {
      // More is allowed where w grazes another face, at which the tensions are, too: the one that separates s w,
      // without its part along d.
      if (off > allowed) return false;
      remove_free(problem, tensions, missing);
      if (!(scale_to_unit(missing) > 0)) return false;
      const Real beyond = dot<N>(missing, problem.wrench) - Real(0.999) * Real(kGrazing) * length;
      if (beyond > 0) subtract(d, beyond / s.wrench, missing);
      scale_to_unit(missing);
      const Side face = side(problem, tensions, missing);
      if (face.gap > allowed || std::abs(face.wrench) > Real(kGrazing) * length) return false;
    }
    if (scale * length < -near) return false;
    // The wrench nearest to s w is a little shorter along w than s w is.
    if ((most.largest() - scale) * length > near + off * line.along / length) return false;
    finding->scale = scale < 0 ? 0 : scale;
    return true;
  }

  int m_;
  const Real* weights_;
  Real roots_[N], lighter_[N];
  Rule rule_;
  Real tolerance_, rank_tolerance_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
