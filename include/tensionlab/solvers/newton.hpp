// The exact tension solver: Newton steps on the dual, and the policies for infeasible wrenches.
//
//   minimise |t - t0|^2 / 2   subject to   W t = w,  a <= t <= b
//
// Newton steps (tensionlab/solvers/dual_step.hpp) render w, or find a p with p'w > h(p) = sum_i max(p'W_i a_i,
// p'W_i b_i): then p separates w from all feasible wrenches, and the policy applies:
//   force      proximal steps converge to the nearest feasible wrench and, among its tensions, to those closest to
//   t0
//              (Chiche & Gilbert 2016);
//   tension    the same on B W, B w, with B from the singular values of W;
//   direction  the largest s for which s w is feasible (tensionlab/solvers/scale_search.hpp), and all of w within
//   tolerance.
//
// Sources: Qi & Sun (1993) for the semismooth method; Kunisch & Rendl (2003) for programs with bounds only.
// No heap, no exceptions; Real may be float, and L may be 1, as on a microcontroller.
#pragma once

#include <cmath>
#include <limits>

#include "tensionlab/simd/linear.hpp"
#include "tensionlab/solvers/dual_step.hpp"
#include "tensionlab/solvers/scale_search.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The coordinates in which one policy measures the error of a wrench that is out of reach.

// The problem in x = B w. Multipliers y are converted with it, so that W'y stays the same as far as possible.
template <class Real, int N, int M>
struct Coordinates {
  Real basis[N][N], structure[N * M], wrench[N];

  // Multiplies every component by the root of its weight, so that the error counts by its plain length.
  void weigh(int m, const Real* given, const Real* desired, const Real* roots, Real* y) {
    for (int k = 0; k < N; ++k) {
      for (int j = 0; j < N; ++j) basis[k][j] = k == j ? roots[k] : Real(0);
      wrench[k] = roots[k] * desired[k];
      y[k] /= roots[k];
      for (int i = 0; i < m; ++i) structure[k * m + i] = roots[k] * given[k * m + i];
    }
  }

  // Makes the rows of W orthonormal.
  void whiten(int m, const Real* given, const Real* desired, Real rank_tolerance, Real* y) {
    const Whitening<Real, N, M> whitening(given, N, m, rank_tolerance);
    Real pull[M];
    for (int i = 0; i < m; ++i) {
      pull[i] = 0;
      for (int k = 0; k < N; ++k) pull[i] += given[k * m + i] * y[k];
    }
    for (int r = 0; r < N; ++r) {
      wrench[r] = y[r] = 0;
      for (int k = 0; k < N; ++k) {
        basis[r][k] = r < whitening.rank ? whitening.rows[r][k] : Real(0);
        wrench[r] += basis[r][k] * desired[k];
      }
      for (int i = 0; i < m; ++i) {
        Real sum = 0;
        for (int k = 0; k < N; ++k) sum += basis[r][k] * given[k * m + i];
        structure[r * m + i] = sum;
        y[r] += sum * pull[i];
      }
    }
  }

  // Converts a direction or multiplier back: out = B'd.
  void back(const Real* d, Real* out) const {
    for (int k = 0; k < N; ++k) {
      out[k] = 0;
      for (int j = 0; j < N; ++j) out[k] += basis[j][k] * d[j];
    }
  }
};

template <class Real, int L, int N, int M>
class Newton {
 public:
  // Iterations of a problem at most, far beyond any known one. At the end it keeps its best answer.
  static constexpr int kIterationLimit = 2000;

  // m cables; weight_roots: square roots of the n wrench weights. tolerance: the error of a wrench that counts as
  // rendered, for the direction policy.
  Newton(int m, const Real* weight_roots, Policy policy, Real rank_tolerance, Real tolerance,
         int iteration_limit = kIterationLimit)
      : m_(m),
        policy_(policy),
        rank_tolerance_(rank_tolerance),
        tolerance_(tolerance),
        iteration_limit_(iteration_limit),
        steps_(m) {
    for (int k = 0; k < N; ++k) weight_roots_[k] = weight_roots[k];
    for (int l = 0; l < L; ++l) idle(l);
  }

  // Not copied: lanes point into the object.
  Newton(const Newton&) = delete;
  Newton& operator=(const Newton&) = delete;

  // What becomes of wrenches that are proved infeasible. separate_only: their lanes are done then, and the caller
  // finds the nearest ones.
  void treat_infeasible(Policy policy, bool separate_only) {
    policy_ = policy;
    separate_only_ = separate_only;
  }

  // Gives lane l a problem of zeros.
  void idle(int l) { load(l, {zeros_, zeros_, zeros_, zeros_, zeros_}); }

  void load(int l, const Problem<Real>& problem) {
    Control& control = control_[l];
    control.problem = problem;
    control.iterations = 0;
    control.failed = false;
    render(l);
  }

  void step() { steps_.step(); }

  // Whether lane l is done; if not, moves it to its next stage where one ends. Call after step().
  bool finished(int l) {
    Control& control = control_[l];
    const bool late = ++control.iterations >= control.deadline;
    if (!late && read<Real>(steps_.found, l) == 0) return false;
    return read<Real>(steps_.converged, l) != 0 ? rendered(l) : conclude(l, late);
  }

  // Whether lane l is done with a direction that separates its wrench, and nothing else.
  bool separated(int l) const { return control_[l].stage == Stage::separated; }

  // Whether Newton steps alone did not solve the problem of lane l.
  bool failed(int l) const { return control_[l].failed; }

  // Stores the answer of lane l: tensions (m), a separating direction or zeros (n). Returns its iterations.
  int store(int l, Real* tensions, Real* separation) const {
    const Control& control = control_[l];
    if (separated(l)) {
      for (int k = 0; k < N; ++k) separation[k] = read<Real>(steps_.direction[k], l);
      return control.iterations;
    }
    for (int i = 0; i < m_; ++i) tensions[i] = steps_.tension(i, l);
    for (int k = 0; k < N; ++k) separation[k] = control.failed ? control.separation[k] : Real(0);
    return control.iterations;
  }

 private:
  // render: solves W t = s w. whitened: the same with orthonormal rows of W, if that takes long. nearest: finds
  // the nearest feasible wrench to s w (s is 1 except for the direction policy). separated: w is infeasible; done.
  enum class Stage { render, whitened, nearest, separated };

  // Iterations of a stage.
  static constexpr int kRenderLimit = 50, kNearestLimit = 400;

  // Error of a wrench that is as good as rendered, as a share of the sum of its parts.
  static constexpr Real kNegligible = std::numeric_limits<Real>::epsilon() < Real(1e-10) ? Real(1e-9) : Real(1e-4);

  // State of one lane for its rare decisions, in plain numbers. Up to `failed` it is set for every problem, the
  // rest only for those that Newton steps alone do not solve.
  struct Control {
    Problem<Real> problem;  // in lane coordinates
    Stage stage;
    int iterations, deadline;  // so far, and when the stage must end
    bool failed;
    Problem<Real> given;          // the problem as it is
    bool plain;                   // lane coordinates are as given
    bool no_scale;                // no s keeps the direction
    ScaleSearch<Real, N> search;  // of the direction policy
    Real target[N];               // s w in lane coordinates
    Real separation[N];           // the best separating direction so far, of unit length
    Coordinates<Real, N, M> coordinates;
  };

  // Handles lane l, which found no tensions or is late; returns whether it is done.
  bool conclude(int l, bool late) {
    Control& control = control_[l];
    if (separate_only_ && !late && control.stage == Stage::render) {
      control.stage = Stage::separated;
      return true;
    }
    if (!control.failed) note_failure(l);
    if (control.iterations >= iteration_limit_) return true;
    Real d[N];
    for (int k = 0; k < N; ++k) d[k] = read<Real>(steps_.direction[k], l);
    if (control.stage == Stage::render && late) {
      render_whitened(l, d);
      return false;
    }
    const bool back = control.stage == Stage::whitened;
    if (back) unwhiten(l, d);
    if (back && nearly_rendered(l)) return rendered(l);
    if (control.stage != Stage::nearest) {
      // A rough first cut costs nothing; later ones must be good.
      if (!late && policy_ == Policy::direction && control.search.fresh() && cut(l, d)) return false;
      approach(l, d);
      return false;
    }
    if (policy_ == Policy::direction && !control.no_scale) return !cut(l, d) && !reopen(l);
    if (!control.no_scale) keep(l, d);
    return true;
  }

  void note_failure(int l) {
    Control& control = control_[l];
    control.failed = control.plain = true;
    control.no_scale = false;
    control.given = control.problem;
    control.search.begin(control.given, m_, tolerance_);
    for (int k = 0; k < N; ++k) control.separation[k] = 0;
  }

  // Bounds the iterations of the stage that begins.
  void allow(int l, int iterations) {
    const int end = control_[l].iterations + iterations;
    control_[l].deadline = end < iteration_limit_ ? end : iteration_limit_;
  }

  // Looks for tensions that render the wrench of lane l.
  void render(int l) {
    Control& control = control_[l];
    control.stage = Stage::render;
    allow(l, kRenderLimit);
    steps_.render(l, control.problem);
  }

  // Looks for them in coordinates where W is well-conditioned, by proximal steps, from the multiplier y.
  void render_whitened(int l, Real* y) {
    Control& control = control_[l];
    whiten(l, y);
    aim(l);
    control.stage = Stage::whitened;
    allow(l, kNearestLimit);
    steps_.approach(l, control.problem, y);
  }

  // Returns to the given coordinates, with the multiplier y.
  void unwhiten(int l, Real* y) {
    Control& control = control_[l];
    Real whitened[N];
    copy<N>(y, whitened);
    control.coordinates.back(whitened, y);
    control.plain = true;
    control.problem = control.given;
    aim(l);
  }

  // Whether the error is so small that it may be rounding.
  bool nearly_rendered(int l) const {
    const Control& control = control_[l];
    Real error = 0, size = 0;
    for (int k = 0; k < N; ++k) {
      Real missing = control.target[k], sum = 0;
      for (int i = 0; i < m_; ++i) {
        const Real part = control.problem.structure[k * m_ + i] * steps_.tension(i, l);
        missing -= part;
        sum += std::abs(part);
      }
      error = larger(error, std::abs(missing));
      size = larger(size, sum);
    }
    return error <= kNegligible * size;
  }

  // Looks for the feasible wrench nearest to s w, from the multiplier y. Only here do the error's weights matter.
  void approach(int l, const Real* y) {
    Control& control = control_[l];
    control.stage = Stage::nearest;
    allow(l, kNearestLimit);
    Real start[N];
    copy<N>(y, start);
    if (policy_ == Policy::tension) whiten(l, start);
    if (policy_ == Policy::force || control.no_scale) weigh(l, start);
    aim(l);
    steps_.approach(l, control.problem, start);
  }

  // Makes s w the wrench of lane l.
  void aim(int l) {
    Control& control = control_[l];
    const Real* wrench = control.plain ? control.given.wrench : control.coordinates.wrench;
    for (int k = 0; k < N; ++k) control.target[k] = control.search.scale * wrench[k];
    control.problem.wrench = control.target;
  }

  void weigh(int l, Real* y) {
    Control& control = control_[l];
    control.coordinates.weigh(m_, control.given.structure, control.given.wrench, weight_roots_, y);
    control.plain = false;
    control.problem.structure = control.coordinates.structure;
  }

  void whiten(int l, Real* y) {
    Control& control = control_[l];
    control.coordinates.whiten(m_, control.given.structure, control.given.wrench, rank_tolerance_, y);
    control.plain = false;
    control.problem.structure = control.coordinates.structure;
  }

  // Lowers s, as d separates s w from the feasible wrenches. Returns false if s cannot fall further.
  bool cut(int l, Real* d) {
    Control& control = control_[l];
    const auto outcome = control.search.cut(control.given, m_, d);
    copy<N>(control.search.proof, control.separation);
    control.no_scale = outcome == ScaleSearch<Real, N>::Outcome::no_scale;
    if (control.no_scale) {
      approach(l, d);
      return true;
    }
    if (outcome == ScaleSearch<Real, N>::Outcome::best) return false;
    seek(l, d);
    return true;
  }

  // Whether lane l is done, now that its s w is rendered.
  bool rendered(int l) {
    const Control& control = control_[l];
    return !control.failed || control.search.scale == 1 || !reopen(l);
  }

  // Looks for a larger s within tolerance where the direction policy cannot lower s further; returns whether there
  // may be one.
  bool reopen(int l) {
    Control& control = control_[l];
    if (policy_ != Policy::direction || control.no_scale) return false;
    if (!control.search.reopen(control.given, m_)) return false;
    Real d[N];
    copy<N>(control.search.proof, d);
    seek(l, d);
    return true;
  }

  // Looks for tensions that render the s w of the search, or, within tolerance, are nearest to it.
  void seek(int l, const Real* d) {
    Control& control = control_[l];
    control.plain = true;
    control.problem = control.given;
    if (control.search.near()) return approach(l, d);
    aim(l);
    render(l);
  }

  // Stores d, in lane coordinates, as the best separating direction so far.
  void keep(int l, const Real* d) {
    Control& control = control_[l];
    if (control.plain) {
      copy<N>(d, control.separation);
    } else {
      control.coordinates.back(d, control.separation);
    }
    normalise<N>(control.separation);
  }

  int m_;
  Policy policy_;
  Real rank_tolerance_, tolerance_;
  int iteration_limit_;
  bool separate_only_ = false;
  Real weight_roots_[N];
  DualStep<Real, L, N, M> steps_;
  Control control_[L];
  Real zeros_[N * M] = {};
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
