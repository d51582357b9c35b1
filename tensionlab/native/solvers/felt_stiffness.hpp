// What a hand feels of a stiffness matrix of modules, whose rest lengths a host moves late.
#pragma once

#include <cmath>

#include "solvers/kernels.hpp"

namespace tensionlab {

// What a hand feels of a stiffness matrix (d x d) along a unit axis (d), with the host's corrections: `predict` of
// tensionlab/haptics/rendering/field.py.
struct FeltStiffness {
  double along = 0, across = 0, added = 0, share = 1, error = 0, coupling = 0;
};

inline FeltStiffness predict_stiffness(int d, const double* matrix, const double* axis, double desired,
                                       double host) {
  FeltStiffness felt;
  double column[kMaxComponents], trace = 0, coupling = 0, own = 0, squares = 0, onto_axis = 0;
  for (int a = 0; a < d; ++a) {
    column[a] = 0;
    for (int b = 0; b < d; ++b) column[a] += matrix[a * d + b] * axis[b];
    felt.along += axis[a] * column[a];
    trace += matrix[a * d + a];
  }
  for (int a = 0; a < d; ++a) {
    column[a] -= felt.along * axis[a];
    coupling += column[a] * column[a];
  }
  double room = host;
  if (coupling > 1e-18 * desired * desired) {
    for (int a = 0; a < d; ++a) {
      double image = 0;
      for (int b = 0; b < d; ++b) image += matrix[a * d + b] * column[b];
      own += column[a] * image / coupling;
      squares += image * image / coupling;
      onto_axis += axis[a] * image;
    }
    // The third axis, if there is one, is free to move: its stiffness, and its coupling squared.
    const double third = trace - felt.along - own;
    const double aside = squares - own * own - onto_axis * onto_axis / coupling;
    const double m = own - aside / (host + third + 1e-300);
    felt.share = std::fmin(host * (m + std::sqrt(m * m + 4.0 * coupling)) / (2.0 * coupling), 1.0);
    room = std::fmax(host - felt.share * felt.share * coupling / (host + felt.share * m), 0.0);
  }
  felt.added = std::fmin(std::fmax(desired - felt.along, 0.0), room);
  felt.coupling = std::sqrt(coupling);
  felt.across = (1.0 - felt.share) * felt.coupling;
  felt.error = desired > 0 ? std::hypot(desired - felt.along - felt.added, felt.across) / desired : 0.0;
  felt.along += felt.added;
  return felt;
}

constexpr double kFullTurn = 6.28318530717958647692;

// Share of a stiffness matrix (d x d) that the lightest hand can bear across a unit axis (d), where rest lengths
// follow it `lag` s late: `stable_share` of tensionlab/haptics/rendering/field.py.
inline double stable_share(int d, const double* matrix, const double* axis, double mass, double lag) {
  double along = 0, trace = 0, all = 0, columns = 0;
  for (int a = 0; a < d; ++a) {
    double column = 0;
    for (int b = 0; b < d; ++b) {
      column += matrix[a * d + b] * axis[b];
      all += matrix[a * d + b] * matrix[a * d + b];
    }
    along += axis[a] * column;
    columns += column * column;
    trace += matrix[a * d + a];
  }
  const double total = trace - along;  // of the eigenvalues across, and of their squares
  const double squares = all - 2.0 * columns + along * along;
  const double largest = (total + std::sqrt(std::fmax(2.0 * squares - total * total, 0.0))) / 2.0;
  const double limit = mass / 8.0 * (kFullTurn / lag) * (kFullTurn / lag);
  return largest > 0 ? std::fmin(limit / largest, 1.0) : 1.0;
}

}  // namespace tensionlab
