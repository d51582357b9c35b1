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
  using Problem = Source<Real>;

  // m cables; weight_roots: square roots of the n wrench weights. set_aside: a lane is done when its wrench proves
  // out of reach, and somebody else seeks the nearest one.
  Newton(int m, const Real* weight_roots, Policy policy, Real rank_tolerance, bool set_aside = false)
      : m_(m), policy_(policy), rank_tolerance_(rank_tolerance), set_aside_(set_aside), steps_(m) {
    for (int k = 0; k < N; ++k) weight_roots_[k] = weight_roots[k];
    for (int l = 0; l < L; ++l) park(l);
  }

  // Lanes point into the object.
  Newton(const Newton&) = delete;
  Newton& operator=(const Newton&) = delete;

  // Give lane l a problem whose numbers are all zero, so that it rests.
  void park(int l) { load(l, {zeros_, zeros_, zeros_, zeros_, zeros_}); }

  void load(int l, const Problem& problem) {
    Control& control = control_[l];
    control.problem = problem;
    control.iterations = 0;
    control.astray = false;
    render(l);
  }

  // One Newton step in every lane.
  void step() { steps_.step(); }

  // Whether lane l is done; moves it to its next stage where there is one. Call after step().
  bool finished(int l) {
    Control& control = control_[l];
    const bool late = ++control.iterations >= control.deadline;
    if (!late && read<Real>(steps_.found, l) == 0) return false;
    return read<Real>(steps_.converged, l) != 0 || conclude(l, late);
  }

  // Whether lane l is done with a direction that separates its wrench, and no more.
  bool aside(int l) const { return control_[l].stage == Stage::aside; }

  // The answer of lane l: tensions (m), a separating direction or zeros (n). Returns the iterations spent.
  int store(int l, Real* tensions, Real* separation) const {
    const Control& control = control_[l];
    if (aside(l)) {
      for (int k = 0; k < N; ++k) separation[k] = read<Real>(steps_.direction[k], l);
      return control.iterations;
    }
    for (int i = 0; i < m_; ++i) tensions[i] = steps_.tension(i, l);
    for (int k = 0; k < N; ++k) separation[k] = control.astray ? control.separation[k] : Real(0);
    return control.iterations;
  }

 private:
  // render: look for W t = s w. whitened: the same where the rows of W are orthonormal, if that takes long.
  // nearest: as close to s w as the limits allow. (s is 1 but for the direction policy.)
  // aside: w is out of reach, and that is all.
  enum class Stage { render, whitened, nearest, aside };

  // Far beyond what any known problem takes; one that gets there keeps its best answer so far.
  static constexpr int kRenderLimit = 50, kNearestLimit = 400, kIterationLimit = 2000;

  // What may be missing of a wrench that is as good as rendered, against the parts it is made of.
  static constexpr Real kNegligible = std::numeric_limits<Real>::epsilon() < Real(1e-10) ? Real(1e-9) : Real(1e-4);

  // What the lanes do not share: the rare decisions, in plain numbers. Up to `astray` it is set for every problem,
  // what follows only for those that cannot be rendered at once.
  struct Control {
    Problem problem;  // in lane coordinates
    Stage stage;
    int iterations, deadline;  // so far, and when the stage must end
    bool astray;
    bool hopeless;      // no s keeps the direction
    Real scale;         // s of the direction policy
    Real below, above;  // s w is too short, if ever; s w is too long
    Real basis[N][N];   // lane coordinates = basis * wrench coordinates
    Real wrench[N];     // as asked, in lane coordinates
    Real target[N];     // s times that
    const Real* given;  // structure and wrench before whitening
    Real unwhitened[N];
    Real separation[N];  // the best separating direction so far, of unit length
    Real from_below[N];  // one that excludes all s < below
  };

  // Lane l has found something other than its tensions, or is late: is it done?
  bool conclude(int l, bool late) {
    Control& control = control_[l];
    if (set_aside_ && !late && control.stage == Stage::render) {
      control.stage = Stage::aside;
      return true;
    }
    if (!control.astray) go_astray(l);
    Real d[N];
    for (int k = 0; k < N; ++k) d[k] = read<Real>(steps_.direction[k], l);
    if (control.stage == Stage::render && late) {
      render_whitened(l, d);
      return false;
    }
    const bool back = control.stage == Stage::whitened;
    if (back) unwhiten(l, d);
    if (back && nearly_rendered(l)) return true;
    if (control.stage != Stage::nearest) {
      const bool first = control.scale == Real(1);  // a rough cut comes for nothing; later ones must be good
      if (!late && first && policy_ == Policy::direction && cut(l, d)) return false;
      approach(l, d);
      return false;
    }
    if (policy_ == Policy::direction && !control.hopeless) {
      return control.iterations >= kIterationLimit || !cut(l, d);
    }
    if (!control.hopeless) keep(l, d);
    return true;
  }

  void go_astray(int l) {
    Control& control = control_[l];
    control.astray = true;
    control.hopeless = false;
    control.scale = control.above = 1;
    control.below = -1;
    copy(control.problem.wrench, control.wrench);
    for (int k = 0; k < N; ++k) {
      control.separation[k] = control.from_below[k] = 0;
    }
    keep_coordinates(l);
  }

  // Lane coordinates as the wrench is given in.
  void keep_coordinates(int l) {
    for (int k = 0; k < N; ++k) {
      for (int j = 0; j < N; ++j) control_[l].basis[k][j] = k == j ? Real(1) : Real(0);
    }
  }

  // Look for tensions that render the wrench of lane l.
  void render(int l) {
    Control& control = control_[l];
    control.stage = Stage::render;
    control.deadline = control.iterations + kRenderLimit;
    steps_.render(l, control.problem);
  }

  // Look for them where W is as well conditioned as can be, by the surest steps, from the multiplier y.
  void render_whitened(int l, Real* y) {
    Control& control = control_[l];
    control.given = control.problem.structure;
    copy(control.wrench, control.unwhitened);
    whiten(l, y);
    aim(l);
    control.stage = Stage::whitened;
    control.deadline = control.iterations + kNearestLimit;
    steps_.approach(l, control.problem, y);
  }

  // Back to the coordinates before; y, a multiplier, follows.
  void unwhiten(int l, Real* y) {
    Control& control = control_[l];
    Real whitened[N];
    copy(y, whitened);
    for (int k = 0; k < N; ++k) {
      y[k] = 0;
      for (int j = 0; j < N; ++j) y[k] += control.basis[j][k] * whitened[j];
    }
    keep_coordinates(l);
    control.problem.structure = control.given;
    copy(control.unwhitened, control.wrench);
    aim(l);
  }

  // Whether so little of the wrench is missing that it may well be rounding.
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

  // Seek the reachable wrench nearest to s w, from the multiplier y. Only here does it matter how errors are
  // measured.
  void approach(int l, const Real* y) {
    Control& control = control_[l];
    control.stage = Stage::nearest;
    control.deadline = control.iterations + kNearestLimit;
    Real start[N];
    copy(y, start);
    if (policy_ == Policy::tension) whiten(l, start);
    if (policy_ == Policy::force || control.hopeless) weigh(l, start);
    aim(l);
    steps_.approach(l, control.problem, start);
  }

  // Make s w the wrench of lane l.
  void aim(int l) {
    Control& control = control_[l];
    for (int k = 0; k < N; ++k) control.target[k] = control.scale * control.wrench[k];
    control.problem.wrench = control.target;
  }

  // W_i'd of cable i, in lane coordinates.
  Real along(int l, int i, const Real* d) const {
    Real sum = 0;
    for (int k = 0; k < N; ++k) sum += d[k] * control_[l].problem.structure[k * m_ + i];
    return sum;
  }

  // Lane coordinates in which the error counts by its plain length; y, a multiplier, follows.
  void weigh(int l, Real* y) {
    Control& control = control_[l];
    for (int k = 0; k < N; ++k) {
      control.basis[k][k] = weight_roots_[k];
      control.wrench[k] *= weight_roots_[k];
      y[k] /= weight_roots_[k];
      for (int i = 0; i < m_; ++i) {
        own_[l][k * m_ + i] = weight_roots_[k] * control.problem.structure[k * m_ + i];
      }
    }
    control.problem.structure = own_[l];
  }

  // Lane coordinates in which the rows of W are orthonormal; y, a multiplier, follows.
  void whiten(int l, Real* y) {
    Control& control = control_[l];
    const Whitening<Real, N, M> whitening(control.problem.structure, N, m_, rank_tolerance_);
    Real w[N], pull[M];
    copy(control.wrench, w);
    for (int i = 0; i < m_; ++i) pull[i] = along(l, i, y);
    for (int r = 0; r < N; ++r) {
      for (int k = 0; k < N; ++k) control.basis[r][k] = r < whitening.rank ? whitening.rows[r][k] : Real(0);
      control.wrench[r] = dot(control.basis[r], w);
      y[r] = 0;
      for (int i = 0; i < m_; ++i) {
        own_[l][r * m_ + i] = along(l, i, control.basis[r]);
        y[r] += own_[l][r * m_ + i] * pull[i];
      }
    }
    control.problem.structure = own_[l];
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
    aim(l);
    render(l);
    return true;
  }

  // No scale keeps the direction, as d proves: the nearest wrench to w is what remains.
  bool give_up(int l, const Real* d) {
    Control& control = control_[l];
    copy(d, control.separation);
    control.hopeless = true;
    control.scale = 1;
    approach(l, d);
    return true;
  }

  // h(d) of a unit vector d, and the error that rounding, also of d itself, may leave in it.
  Real support(int l, const Real* d, Real* rounding) const {
    const Problem& problem = control_[l].problem;
    Real sum = 0, size = 0;
    for (int i = 0; i < m_; ++i) {
      const Real lower = problem.lower[i], upper = problem.upper[i];
      const Real most = larger(std::abs(lower), std::abs(upper)), pull = along(l, i, d);
      for (int k = 0; k < N; ++k) size += std::abs(problem.structure[k * m_ + i]) * most;
      sum += pull * (pull > 0 ? upper : lower);
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
  bool set_aside_;
  Real weight_roots_[N];
  DualStep<Real, L, N, M> steps_;
  Control control_[L];
  Real own_[L][N * M];  // structure matrices in lane coordinates, where those are not as given
  Real zeros_[N * M] = {};
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
