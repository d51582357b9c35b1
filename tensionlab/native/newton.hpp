// The exact tension solver: Newton steps on the dual, and what each policy asks for where no tensions will do.
//
//   minimise |t - t0|^2 / 2   subject to   W t = w,  a <= t <= b
//
// Newton steps (dual_step.hpp) render w, or come upon a p with p'w > h(p) = sum_i max(p'W_i a_i, p'W_i b_i): then
// p separates w from all that tensions inside the limits can render, and the policy takes over:
//   force      proximal steps converge to the nearest reachable wrench and, among its tensions, to those closest
//              to t0 (Chiche & Gilbert 2016);
//   tension    the same on B W, B w, with B from the singular values of W;
//   direction  any separating d shows s <= h(d) / d'w. The nearest wrench to s w gives the next d; s falls to the
//              answer from above (Newton's method on the convex distance from s w to the available wrench set).
//
// Sources: Qi & Sun (1993) for the semismooth method; Kunisch & Rendl (2003) for programs with bounds only.
// No heap, no exceptions; Real may be float, L may be 1: the firmware compiles this file as it is.
#pragma once

#include <cmath>
#include <limits>

#include "dual_step.hpp"
#include "linear.hpp"
#include "policy.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class Newton {
 public:
  // One problem, all pointers to contiguous numbers. structure is n x m, row by row.
  struct Problem {
    const Real *structure, *wrench, *lower, *upper, *reference;
  };

  // m cables; weight_roots: square roots of the n wrench weights.
  Newton(int m, const Real* weight_roots, Policy policy, Real rank_tolerance)
      : m_(m), policy_(policy), rank_tolerance_(rank_tolerance), steps_(m) {
    for (int k = 0; k < N; ++k) weight_roots_[k] = weight_roots[k];
    for (int l = 0; l < L; ++l) park(l);
  }

  // Give lane l a problem whose numbers are all zero, so that it rests.
  void park(int l) {
    const Real zeros[N * M] = {};
    load(l, {zeros, zeros, zeros, zeros, zeros});
  }

  void load(int l, const Problem& problem) {
    Control& control = control_[l];
    control = Control{};
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < m_; ++i) {
        lane<Real>(steps_.structure[i][k], l) = problem.structure[k * m_ + i];
      }
      control.wrench[k] = problem.wrench[k];
      control.basis[k][k] = 1;
    }
    Real strongest = 0;
    for (int i = 0; i < m_; ++i) {
      lane<Real>(steps_.lower[i], l) = problem.lower[i];
      lane<Real>(steps_.upper[i], l) = problem.upper[i];
      lane<Real>(steps_.reference[i], l) = problem.reference[i];
      strongest = larger(strongest, larger(Real(-problem.lower[i]), problem.upper[i]));
    }
    lane<Real>(steps_.strongest, l) = strongest;
    begin(l, Stage::render);
  }

  // One Newton step in every lane.
  void step() { steps_.step(); }

  // Whether lane l is done; moves it to its next stage where there is one. Call after step().
  bool finished(int l) {
    Control& control = control_[l];
    ++control.iterations;
    ++control.in_stage;
    if (read<Real>(steps_.converged, l) != 0) return true;
    Real d[N];
    for (int k = 0; k < N; ++k) d[k] = read<Real>(steps_.direction[k], l);
    if (control.stage == Stage::render) {
      const bool separated = read<Real>(steps_.separated, l) > 0;
      if (!separated && control.in_stage < kRenderLimit) return false;
      const bool first = control.scale == Real(1);  // a rough cut comes for nothing; later ones must be good
      if (separated && first && policy_ == Policy::direction && cut(l, d)) return false;
      approach(l);
      return false;
    }
    if (read<Real>(steps_.settled, l) == 0 && control.in_stage < kNearestLimit) return false;
    if (policy_ == Policy::direction && !control.hopeless) {
      return control.iterations >= kIterationLimit || !cut(l, d);
    }
    if (!control.hopeless) keep(l, d);
    return true;
  }

  // The answer of lane l: tensions (m), a separating direction or zeros (n). Returns the iterations spent.
  int store(int l, Real* tensions, Real* separation) const {
    const Control& control = control_[l];
    for (int i = 0; i < m_; ++i) tensions[i] = steps_.tension(i, l);
    copy(control.separation, separation);
    return control.iterations;
  }

 private:
  // render: look for W t = s w. nearest: as close to s w as the limits allow. (s is 1 but for the direction
  // policy.)
  enum class Stage { render, nearest };

  // Far beyond what any known problem takes; one that gets there keeps its best answer so far.
  static constexpr int kRenderLimit = 100, kNearestLimit = 200, kIterationLimit = 1000;

  // What the lanes do not share: the rare decisions, in plain numbers.
  struct Control {
    Stage stage = Stage::render;
    int iterations = 0, in_stage = 0;
    Real basis[N][N] = {};       // lane coordinates = basis * wrench coordinates
    Real wrench[N] = {};         // as asked, in lane coordinates
    Real separation[N] = {};     // the best separating direction so far, of unit length
    Real from_below[N] = {};     // one that excludes all s < below
    Real scale = 1;              // s of the direction policy
    Real below = -1, above = 1;  // s w is too short, if ever; s w is too long
    bool hopeless = false;       // no s keeps the direction
  };

  // Begin a stage of lane l, for the wrench s w.
  void begin(int l, Stage stage) {
    Control& control = control_[l];
    control.stage = stage;
    control.in_stage = 0;
    Real& asked = lane<Real>(steps_.asked, l);
    asked = 0;
    for (int k = 0; k < N; ++k) {
      asked = larger(asked, magnitude(control.wrench[k]));
      lane<Real>(steps_.wrench[k], l) = control.scale * control.wrench[k];
    }
    steps_.begin(l, stage == Stage::nearest);
  }

  // Seek the reachable wrench nearest to s w. Only here does it matter how errors are measured.
  void approach(int l) {
    if (policy_ == Policy::tension) whiten(l);
    if (policy_ == Policy::force || control_[l].hopeless) weigh(l);
    begin(l, Stage::nearest);
  }

  // Lane coordinates in which the error counts by its plain length.
  void weigh(int l) {
    Control& control = control_[l];
    for (int k = 0; k < N; ++k) {
      control.basis[k][k] = weight_roots_[k];
      control.wrench[k] *= weight_roots_[k];
      for (int i = 0; i < m_; ++i) lane<Real>(steps_.structure[i][k], l) *= weight_roots_[k];
    }
  }

  // Lane coordinates in which the rows of W are orthonormal.
  void whiten(int l) {
    Control& control = control_[l];
    Real columns[M * N], w[N];
    copy(control.wrench, w);
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < m_; ++i) columns[i * N + k] = read<Real>(steps_.structure[i][k], l);
    }
    const Whitening<Real, N, M> whitening(columns, N, m_, rank_tolerance_);
    for (int r = 0; r < N; ++r) {
      for (int k = 0; k < N; ++k) control.basis[r][k] = r < whitening.rank ? whitening.rows[r][k] : Real(0);
      control.wrench[r] = dot(control.basis[r], w);
      for (int i = 0; i < m_; ++i) lane<Real>(steps_.structure[i][r], l) = dot(control.basis[r], columns + i * N);
    }
  }

  // d separates s w from what can be rendered: take the next s. Returns false if s can fall no further.
  bool cut(int l, Real* d) {
    Control& control = control_[l];
    normalise(d);
    Real rounding;
    const Real dw = dot(d, control.wrench), reach = support(l, d, &rounding);
    if (reach + rounding < (dw < 0 ? dw : Real(0))) return give_up(l, d);  // true of all s from 0 to 1
    const Real bound = reach / dw > 0 ? reach / dw : Real(0);
    if (dw > 0) {
      // No scale above the bound will do.
      if (!(bound < control.scale)) return false;
      control.above = bound;
      copy(d, control.separation);
    } else {
      // No scale below the bound will do: s w is too short already.
      control.below = bound;
      copy(d, control.from_below);
    }
    if (control.below > control.above) {
      // Nothing is left in between. The mean of both directions that is normal to w proves it for all s.
      const Real* other = dw > 0 ? control.from_below : control.separation;
      const Real other_dw = dot(other, control.wrench);
      for (int k = 0; k < N; ++k) d[k] = std::abs(other_dw) * d[k] + std::abs(dw) * other[k];
      normalise(d);
      return give_up(l, d);
    }
    control.scale = control.below < 0 ? control.above : (control.below + control.above) / 2;
    begin(l, Stage::render);
    return true;
  }

  // No scale keeps the direction, as d proves: the nearest wrench to w is what remains.
  bool give_up(int l, const Real* d) {
    Control& control = control_[l];
    copy(d, control.separation);
    control.hopeless = true;
    control.scale = 1;
    approach(l);
    return true;
  }

  // h(d) of a unit vector d, and the error that rounding, also of d itself, may leave in it.
  Real support(int l, const Real* d, Real* rounding) const {
    Real sum = 0, size = 0;
    for (int i = 0; i < m_; ++i) {
      const Real lower = read<Real>(steps_.lower[i], l), upper = read<Real>(steps_.upper[i], l);
      const Real most = larger(std::abs(lower), std::abs(upper));
      Real along = 0;
      for (int k = 0; k < N; ++k) {
        const Real entry = read<Real>(steps_.structure[i][k], l);
        along += d[k] * entry;
        size += std::abs(entry) * most;
      }
      sum += along * (along > 0 ? upper : lower);
    }
    *rounding = 64 * std::numeric_limits<Real>::epsilon() * size;
    return sum;
  }

  // d, in lane coordinates, is the best separating direction so far.
  void keep(int l, const Real* d) {
    Control& control = control_[l];
    for (int k = 0; k < N; ++k) {
      control.separation[k] = 0;
      for (int j = 0; j < N; ++j) control.separation[k] += control.basis[j][k] * d[j];
    }
    normalise(control.separation);
  }

  static void normalise(Real* d) {
    const Real length = std::sqrt(dot(d, d));
    for (int k = 0; k < N; ++k) d[k] = length > 0 ? d[k] / length : Real(0);
  }

  static void copy(const Real* from, Real* to) {
    for (int k = 0; k < N; ++k) to[k] = from[k];
  }

  static Real dot(const Real* x, const Real* y) {
    Real sum = 0;
    for (int k = 0; k < N; ++k) sum += x[k] * y[k];
    return sum;
  }

  int m_;
  Policy policy_;
  Real rank_tolerance_;
  Real weight_roots_[N];
  DualStep<Real, L, N, M> steps_;
  Control control_[L];
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
