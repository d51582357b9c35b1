// Stiffnesses and tensions of cables whose field of forces is nearest to a desired one: a strictly convex
// quadratic programme, by the dual active-set method of Goldfarb and Idnani 1983, "A numerically stable dual
// method for solving strictly convex quadratic programs". tensionlab/haptics/rendering/field.py states the
// programme.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "solvers/kernels.hpp"

namespace tensionlab {

// All numbers are dimensionless: stiffness over its largest limit, tension over the largest upper one. directions
// (d x m): of the cables, scaled as the desired stiffness; structure (d x m) and force (d): for the tensions, none
// if structure is null. top, lower, upper, fall, rise (m): 0 <= k <= top, lower + fall k <= t <= upper - rise k.
struct FieldProblem {
  int d, m;
  const double *directions, *desired, *structure, *force, *top, *lower, *upper, *fall, *rise;
  double tie_break;
};

class ImpedanceField {
 public:
  explicit ImpedanceField(const FieldProblem& problem)
      : p_(problem), m_(problem.m), size_(problem.structure ? 2 * problem.m : problem.m) {}

  const double* stiffness() const { return x_; }
  const double* tensions() const { return x_ + m_; }

  // False if no tensions render the force. multipliers (d): of the force; none without tensions.
  bool solve(double* multipliers) {
    start();
    const int equalities = p_.structure ? p_.d : 0;
    for (int row = 0; row < equalities; ++row) {
      Row normal{};
      double violation = p_.force[row];
      for (int i = 0; i < m_; ++i) {
        normal.dense[m_ + i] = p_.structure[row * m_ + i];
        violation -= normal.dense[m_ + i] * x_[m_ + i];
      }
      normal.number = -1 - row;
      if (!add(normal, violation)) return false;
    }
    for (int step = 0; step < kMaxSteps; ++step) {
      Row worst{};
      const double violation = most_violated(worst);
      if (violation <= kTolerance) {
        std::fill_n(multipliers, equalities, 0.0);
        for (int a = 0; a < active_; ++a) {
          if (rows_[a].number < 0) multipliers[-1 - rows_[a].number] = multiplier_[a];
        }
        return true;
      }
      if (!add(worst, violation)) return false;
    }
    return false;
  }

 private:
  static constexpr int kMost = 2 * kMaxCables;
  static constexpr int kMaxSteps = 8 * kMaxCables;
  static constexpr double kTolerance = 1e-9;   // of a limit, as a share of the largest one
  static constexpr double kDependent = 1e-11;  // share of a normal that counts as independent of the active ones

  struct Row {
    double dense[kMost];
    int number;
  };

  // Unconstrained optimum. <u u', v v'> = (u v)² in the Frobenius norm.
  void start() {
    double factor[kMaxCables][kMaxCables];
    for (int i = 0; i < m_; ++i) {
      for (int j = 0; j <= i; ++j) {
        double cosine = 0;
        for (int a = 0; a < p_.d; ++a) cosine += p_.directions[a * m_ + i] * p_.directions[a * m_ + j];
        double entry = p_.top[i] > 0 && p_.top[j] > 0 ? cosine * cosine : 0.0;
        if (i == j) entry += p_.tie_break + (p_.top[i] > 0 ? 0.0 : 1.0);
        for (int k = 0; k < j; ++k) entry -= factor[i][k] * factor[j][k];
        factor[i][j] = i == j ? std::sqrt(entry) : entry / factor[j][j];
      }
    }
    for (int column = 0; column < m_; ++column) {
      double* const inverse = inverse_[column];
      for (int i = 0; i < m_; ++i) {
        double sum = i == column ? 1.0 : 0.0;
        for (int k = column; k < i; ++k) sum -= factor[i][k] * inverse[k];
        inverse[i] = i < column ? 0.0 : sum / factor[i][i];
      }
      for (int i = m_ - 1; i >= 0; --i) {
        double sum = inverse[i];
        for (int k = i + 1; k < m_; ++k) sum -= factor[k][i] * inverse[k];
        inverse[i] = sum / factor[i][i];
      }
    }
    std::fill_n(x_, 2 * m_, 0.0);
    for (int i = 0; i < m_; ++i) {
      double linear = 0;
      for (int a = 0; a < p_.d && p_.top[i] > 0; ++a) {
        for (int b = 0; b < p_.d; ++b) {
          linear += p_.directions[a * m_ + i] * p_.desired[a * p_.d + b] * p_.directions[b * m_ + i];
        }
      }
      for (int j = 0; j < m_; ++j) x_[j] += inverse_[i][j] * linear;
    }
  }

  void times_inverse(const double* from, double* to) const {
    for (int i = 0; i < m_; ++i) {
      double sum = 0;
      for (int j = 0; j < m_; ++j) sum += inverse_[i][j] * from[j];
      to[i] = sum;
    }
    for (int i = m_; i < size_; ++i) to[i] = from[i] / p_.tie_break;
  }

  double product(const double* a, const double* b) const {
    double sum = 0;
    for (int i = 0; i < size_; ++i) sum += a[i] * b[i];
    return sum;
  }

  // The inequality whose violation is largest, and that; four for each cable.
  double most_violated(Row& worst) const {
    double most = 0;
    int number = 0;
    for (int i = 0; i < m_; ++i) {
      const double k = x_[i], t = x_[m_ + i];
      const double below[4] = {-k, k - p_.top[i], size_ > m_ ? p_.lower[i] + p_.fall[i] * k - t : 0.0,
                               size_ > m_ ? t - p_.upper[i] + p_.rise[i] * k : 0.0};
      for (int kind = p_.top[i] > 0 ? 0 : 2; kind < 4; ++kind) {
        if (below[kind] > most) {
          most = below[kind];
          number = 4 * i + kind;
        }
      }
    }
    const int cable = number / 4, kind = number % 4;
    worst.number = number;
    if (kind < 2) {
      worst.dense[cable] = kind == 0 ? 1.0 : -1.0;
    } else {
      worst.dense[m_ + cable] = kind == 2 ? 1.0 : -1.0;
      if (p_.top[cable] > 0) worst.dense[cable] = kind == 2 ? -p_.fall[cable] : -p_.rise[cable];
    }
    return most;
  }

  // Moves to the optimum that also keeps this constraint; false if none does.
  bool add(const Row& normal, double violation) {
    double image[kMost], step[kMost], change[kMost];
    times_inverse(normal.dense, image);
    double multiplier = 0;
    for (int tries = 0; tries <= kMost; ++tries) {
      std::copy_n(image, size_, step);
      solve_active(normal.dense, change);
      for (int a = 0; a < active_; ++a) {
        for (int i = 0; i < size_; ++i) step[i] -= change[a] * images_[a][i];
      }
      const double slope = product(step, normal.dense);
      const bool dependent = !(slope > kDependent * product(image, normal.dense));
      int blocking = -1;
      double length = dependent ? std::numeric_limits<double>::infinity() : violation / slope;
      for (int a = 0; a < active_; ++a) {  // an equality's multiplier may have any sign
        if (rows_[a].number >= 0 && change[a] > 0 && multiplier_[a] < length * change[a]) {
          length = multiplier_[a] / change[a];
          blocking = a;
        }
      }
      if (dependent && blocking < 0) return normal.number < 0 && std::abs(violation) <= kTolerance;
      if (!dependent) {
        for (int i = 0; i < size_; ++i) x_[i] += length * step[i];
        violation -= length * slope;
      }
      for (int a = 0; a < active_; ++a) multiplier_[a] -= length * change[a];
      multiplier += length;
      if (blocking < 0) {
        push(normal, image, multiplier);
        return true;
      }
      drop(blocking);
    }
    return false;
  }

  // Coefficients of the active normals in another one, in the metric of the inverse.
  void solve_active(const double* normal, double* change) const {
    double factor[kMost][kMost];
    for (int a = 0; a < active_; ++a) {
      double right = product(images_[a], normal);
      for (int b = 0; b <= a; ++b) {
        double entry = gram_[a][b];
        for (int k = 0; k < b; ++k) entry -= factor[a][k] * factor[b][k];
        factor[a][b] = a == b ? std::sqrt(entry) : entry / factor[b][b];
      }
      for (int k = 0; k < a; ++k) right -= factor[a][k] * change[k];
      change[a] = right / factor[a][a];
    }
    for (int a = active_ - 1; a >= 0; --a) {
      for (int k = a + 1; k < active_; ++k) change[a] -= factor[k][a] * change[k];
      change[a] /= factor[a][a];
    }
  }

  void push(const Row& normal, const double* image, double multiplier) {
    std::copy_n(image, size_, images_[active_]);
    std::copy_n(normal.dense, size_, rows_[active_].dense);
    rows_[active_].number = normal.number;
    multiplier_[active_] = multiplier;
    for (int a = 0; a <= active_; ++a) gram_[active_][a] = product(rows_[a].dense, image);
    ++active_;
  }

  void drop(int gone) {
    for (int a = gone; a + 1 < active_; ++a) {
      std::copy_n(images_[a + 1], size_, images_[a]);
      rows_[a] = rows_[a + 1];
      multiplier_[a] = multiplier_[a + 1];
      for (int b = 0; b <= a; ++b) gram_[a][b] = gram_[a + 1][b < gone ? b : b + 1];
    }
    --active_;
  }

  FieldProblem p_;
  int m_, size_, active_ = 0;
  double x_[kMost], inverse_[kMaxCables][kMaxCables];
  double images_[kMost][kMost], gram_[kMost][kMost], multiplier_[kMost];
  Row rows_[kMost];
};

// Certificate: bound on how far stiffnesses k and tensions t (none if structure is null) are from the optimum,
// infinite outside the ranges. The objective is convex, so its gradient bounds it from below; the least of that
// bound over each cable's ranges is at a corner of them. multipliers (d) price the force.
inline double field_gap(const FieldProblem& p, const double* k, const double* t, const double* multipliers) {
  constexpr double kOutside = 2e-9;
  double gap = 0, weighted[kMaxComponents][kMaxComponents] = {};  // K - sum k u u'
  for (int a = 0; a < p.d; ++a) {
    double missing = p.structure ? p.force[a] : 0.0;
    for (int i = 0; i < p.m && p.structure; ++i) missing -= p.structure[a * p.m + i] * t[i];
    if (p.structure) gap += std::abs(multipliers[a] * missing);
    for (int b = 0; b < p.d; ++b) {
      weighted[a][b] = p.desired[a * p.d + b];
      for (int i = 0; i < p.m; ++i) {
        weighted[a][b] -= k[i] * p.directions[a * p.m + i] * p.directions[b * p.m + i];
      }
    }
  }
  for (int i = 0; i < p.m; ++i) {
    double of_k = p.tie_break * k[i], of_t = 0;
    for (int a = 0; a < p.d; ++a) {
      for (int b = 0; b < p.d; ++b) {
        of_k -= p.directions[a * p.m + i] * weighted[a][b] * p.directions[b * p.m + i];
      }
      if (p.structure) of_t -= multipliers[a] * p.structure[a * p.m + i];
    }
    bool inside = k[i] >= -kOutside && k[i] <= p.top[i] + kOutside;
    double end = p.top[i], least = std::fmin(-of_k * k[i], of_k * (end - k[i]));
    if (p.structure) {
      const double fall = p.fall[i], rise = p.rise[i];
      inside =
          inside && t[i] >= p.lower[i] + fall * k[i] - kOutside && t[i] <= p.upper[i] - rise * k[i] + kOutside;
      of_t += p.tie_break * t[i];
      if (fall + rise > 0) end = std::fmin(end, (p.upper[i] - p.lower[i]) / (fall + rise));
      const double start = std::fmin(of_t * (p.lower[i] - t[i]), of_t * (p.upper[i] - t[i]));
      const double stop =
          std::fmin(of_t * (p.lower[i] + fall * end - t[i]), of_t * (p.upper[i] - rise * end - t[i]));
      least = std::fmin(start - of_k * k[i], stop + of_k * (end - k[i]));
    }
    gap = inside ? gap - least : std::numeric_limits<double>::infinity();
  }
  return gap;
}

// The programme in N, N/m, N s/m and m. structure (d x m); force (d); desired (2 x d x d): stiffness and damping;
// ranges (6 x m): of tensions, lower and upper; the largest stiffness and damping; fall and rise. Directions that
// the desired stiffness leaves free have the weight free_weight.
struct FieldInput {
  int d, m;
  const double *structure, *force, *desired, *ranges;
  double free_weight, tie_break;
};

// The programme as shares of the largest limits.
class ScaledField {
 public:
  double stiffness = 0, damping = 0, tension = 0;  // the largest limits; 1 instead of 0

  explicit ScaledField(const FieldInput& input)
      : d_(input.d), m_(input.m), structure_(input.structure), tie_break_(input.tie_break) {
    const int d = d_, m = m_;
    const double *const structure = input.structure, *const desired = input.desired, *const ranges = input.ranges;
    const double free_weight = input.free_weight;
    double* const scales[] = {&tension, &tension, &stiffness, &damping};
    for (int row = 1; row < 4; ++row) {
      const double largest = *std::max_element(ranges + row * m, ranges + (row + 1) * m);
      *scales[row] = largest > 0 || largest != largest ? largest : 1.0;
    }
    for (int row = 0; row < 6; ++row) {
      const double by = row < 4 ? 1.0 / *scales[row] : stiffness / tension;
      for (int i = 0; i < m; ++i) ranges_[row][i] = by * ranges[row * m + i];
    }
    double weight[kMaxComponents * kMaxComponents], squares = 0;
    for (int e = 0; e < d * d; ++e) squares += desired[e] * desired[e];
    for (int e = 0; e < d * d; ++e) {
      weight[e] = squares != 0 ? (1.0 - free_weight) / std::sqrt(squares) * desired[e] : 0.0;
      if (e % (d + 1) == 0) weight[e] += free_weight;
    }
    multiply(weight, structure, m, directions_);
    for (int part = 0; part < 2; ++part) {
      double half[kMaxComponents * kMaxComponents];
      multiply(desired + part * d * d, weight, d, half);
      multiply(weight, half, d, desired_[part]);
      for (int e = 0; e < d * d; ++e) desired_[part][e] /= part == 0 ? stiffness : damping;
    }
    for (int a = 0; a < d; ++a) force_[a] = input.force[a] / tension;
  }

  FieldProblem springs() const { return problem(0, structure_); }
  FieldProblem dampers() const { return problem(1, nullptr); }

 private:
  // (d x d) times (d x columns).
  void multiply(const double* left, const double* right, int columns, double* product) const {
    for (int a = 0; a < d_; ++a) {
      for (int i = 0; i < columns; ++i) {
        double sum = 0;
        for (int b = 0; b < d_; ++b) sum += left[a * d_ + b] * right[b * columns + i];
        product[a * columns + i] = sum;
      }
    }
  }

  FieldProblem problem(int part, const double* structure) const {
    return {d_,         m_,         directions_, desired_[part], structure, force_, ranges_[2 + part],
            ranges_[0], ranges_[1], ranges_[4],  ranges_[5],     tie_break_};
  }

  int d_, m_;
  const double* structure_;
  double tie_break_, directions_[kMaxComponents * kMaxCables], force_[kMaxComponents];
  double desired_[2][kMaxComponents * kMaxComponents], ranges_[6][kMaxCables];
};

// Stiffness, damping and tensions of each cable, with their force and its multipliers. gap: the certificate,
// infinite, without stiffness, where nothing was found. A force that no tensions render is replaced by one just
// inside the feasible ones, by `nearest`.
struct FieldAnswer {
  double stiffness[kMaxCables], damping[kMaxCables], tensions[kMaxCables], force[kMaxComponents];
  double multipliers[kMaxComponents], gap;

  explicit FieldAnswer(const FieldInput& input) {
    std::copy_n(input.force, input.d, force);
    std::copy_n(input.ranges, input.m, tensions);
    if (solve(input)) return;
    FieldInput feasible = input;
    feasible.force = force;
    if (nearest(input) && solve(feasible)) return;
    std::fill_n(stiffness, input.m, 0.0);
    std::fill_n(damping, input.m, 0.0);
    std::fill_n(multipliers, input.d, 0.0);
    gap = std::numeric_limits<double>::infinity();
  }

 private:
  bool solve(const FieldInput& input) {
    const ScaledField field(input);
    const FieldProblem springs = field.springs(), dampers = field.dampers();
    ImpedanceField with_tensions(springs), without(dampers);
    if (!with_tensions.solve(multipliers) || !without.solve(nullptr)) return false;
    for (int i = 0; i < input.m; ++i) {
      stiffness[i] = std::clamp(with_tensions.stiffness()[i], 0.0, springs.top[i]);
      damping[i] = std::clamp(without.stiffness()[i], 0.0, dampers.top[i]);
      tensions[i] =
          std::fmin(std::fmax(with_tensions.tensions()[i], springs.lower[i] + springs.fall[i] * stiffness[i]),
                    springs.upper[i] - springs.rise[i] * stiffness[i]);
    }
    gap = field_gap(springs, stiffness, tensions, multipliers) + field_gap(dampers, damping, nullptr, nullptr);
    const double* const top = input.ranges + 2 * input.m;  // rounding must not exceed it
    for (int i = 0; i < input.m; ++i) {
      stiffness[i] = std::fmin(stiffness[i] * field.stiffness, top[i]);
      damping[i] = std::fmin(damping[i] * field.damping, top[input.m + i]);
      tensions[i] *= field.tension;
    }
    sum_force(input);
    return std::isfinite(gap);
  }

  // Tensions whose force is the nearest to the desired one, kept off the edge of the feasible ones.
  bool nearest(const FieldInput& input) {
    constexpr double kInside = 1e-6, kLargest = 1e100, kRankTolerance = 1e-8, kTolerance = 1e-6;
    for (int a = 0; a < input.d; ++a) {
      if (!(std::abs(input.force[a]) < kLargest)) return false;
    }
    const double zeros[kMaxCables] = {}, ones[kMaxComponents] = {1, 1, 1, 1, 1, 1};
    const double *const lower = input.ranges, *const upper = input.ranges + input.m;
    const Problem<double> problem{input.structure, input.force, lower, upper, zeros};
    const Batch batch = batch_of_one(input.d, input.m, problem, ones);
    double separation[kMaxComponents];
    std::int64_t iterations = 0;
    newton_for_this_processor()(batch, Policy::force, kRankTolerance, kTolerance, {0, 1}, 0,
                                {tensions, separation, &iterations});
    for (int i = 0; i < input.m; ++i) tensions[i] += kInside * ((lower[i] + upper[i]) / 2 - tensions[i]);
    sum_force(input);
    return true;
  }

  void sum_force(const FieldInput& input) {
    for (int a = 0; a < input.d; ++a) {
      force[a] = 0;
      for (int i = 0; i < input.m; ++i) force[a] += input.structure[a * input.m + i] * tensions[i];
    }
  }
};

}  // namespace tensionlab
