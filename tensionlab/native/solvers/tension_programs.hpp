// The tension programs as linear programs whose limits close in (solvers/linear_program.hpp).
//
//   least sum      minimise sum t                               [W; 1'] t + (0, 1) S = (w, 0),  a <= t <= b
//   minimax        minimise max t, which is -S                  W t = w,  a <= t <= min(b, -S)
//   optimally safe maximise S, a + S <= t <= b - alpha S        W t = w
//
// In the last two a cable whose limits are equal does not count, neither as the largest tension nor as the least
// margin.
#pragma once

#include <limits>

#include "simd/batch.hpp"
#include "solvers/linear_program.hpp"

namespace tensionlab {

enum class Program { least_sum, minimax, safe };

inline namespace TENSIONLAB_BUILD {

template <class Real, int N, int M>
class TensionProgram {
 public:
  // N: wrench components, and one more for the least sum. alpha: of the optimally safe tensions only.
  TensionProgram(int m, Program program, Real alpha) : m_(m), program_(program), alpha_(alpha), linear_(m) {}

  // Finds limits that the best tensions keep, and no others that render the wrench; those of the problem if it is
  // infeasible. Returns the steps.
  int tighten(const Problem<Real>& problem, Real* lower, Real* upper) {
    const bool found = load(problem);
    if (found) linear_.face(lower, upper);
    for (int i = 0; i < m_; ++i) {
      const Real a = problem.lower[i], b = problem.upper[i];
      if (!found) {
        lower[i] = a;
        upper[i] = b;
      }
      lower[i] = smaller(larger(lower[i], a), b);
      upper[i] = smaller(larger(upper[i], lower[i]), b);  // rounding may have crossed them
    }
    return linear_.steps();
  }

 private:
  // Solves the program; returns whether the wrench is feasible.
  bool load(const Problem<Real>& problem) {
    const bool sum = program_ == Program::least_sum;
    const int n = sum ? N - 1 : N;
    Real start[N] = {};
    for (int k = 0; k < n; ++k) {
      const Real* row = problem.structure + k * m_;
      linear_.target[k] = start[k] = problem.wrench[k];
      for (int i = 0; i < m_; ++i) linear_.rows[k][i] = row[i];
    }
    linear_.most = std::numeric_limits<Real>::max();
    for (int i = 0; i < m_; ++i) {
      const Real a = problem.lower[i], b = problem.upper[i];
      ClosingLimits<Real>& limits = linear_.cables.limits[i];
      if (sum) limits = {a, b, 0, 0, 0, 0};
      if (program_ == Program::minimax) limits = {a, 0, 0, 1, -b, -a};
      if (program_ == Program::safe) limits = {a, b, 1, alpha_, 0, (b - a) / (1 + alpha_)};
      if (sum) linear_.rows[n][i] = 1;
      // S has its best value where the first cable has no more room, though the others have.
      if (!sum && a < b) linear_.most = smaller(linear_.most, limits.shut);
      const Real closed = limits.lower + limits.rise * limits.shut;
      for (int k = 0; k < n; ++k) start[k] -= closed * linear_.rows[k][i];
    }
    if (sum) {
      // The start is the sum alone. Otherwise it is the error of the tensions when all limits are closed.
      for (int k = 0; k < n; ++k) start[k] = 0;
      start[n] = -1;
      linear_.gain[n] = 1;
      linear_.least = 0;
      for (int i = 0; i < m_; ++i) linear_.least -= problem.upper[i];
    }
    return linear_.solve(start);
  }

  int m_;
  Program program_;
  Real alpha_;
  LinearProgram<Real, N, M> linear_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
