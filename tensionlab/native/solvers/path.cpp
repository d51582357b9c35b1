// Tensions along a path whose rates are limited, by a primal-dual interior-point method.
//
// Only neighbouring samples are coupled, so that the matrix of each step is block tridiagonal (Rao, Wright and
// Rawlings, 1998). Steps are predicted and corrected after Mehrotra (1992). The multipliers of a step prove the
// path infeasible, or how near the optimum is; Python verifies both.
#include <algorithm>
#include <cmath>
#include <vector>

#include "solvers/kernels.hpp"

namespace tensionlab {
namespace {

constexpr int kIterationLimit = 80;       // 15 to 25 are usual
constexpr double kAccuracy = 1e-15;       // of the mean product of slack and multiplier
constexpr double kStart = 1.0;            // smallest slack, and multipliers, that it starts from
constexpr double kStepShare = 0.995;      // of the way to the border of the interior
constexpr double kPolishingWeight = 1e7;  // of active constraints when their equations are solved at last
constexpr int kPolishingSteps = 3;
constexpr std::size_t kParts = 8;  // partial results of a reduction
#if defined(TENSIONLAB_GNU_LIKE)
constexpr int kWidth = 2;  // of vectors that every processor has; wider ones are no faster
#else
constexpr int kWidth = 1;
#endif

template <class Term>
double sum(std::size_t size, const Term& term) {
  double parts[kParts] = {};
  std::size_t i = 0;
  for (; i + kParts <= size; i += kParts) {
    for (std::size_t p = 0; p < kParts; ++p) parts[p] += term(i + p);
  }
  double total = 0.0;
  for (; i < size; ++i) total += term(i);
  for (const double part : parts) total += part;
  return total;
}

// The largest share of a change, up to 1, that leaves all values above zero, by their relative changes.
template <class Term>
double share(std::size_t size, const Term& relative_change) {
  double parts[kParts];
  std::fill_n(parts, kParts, -1.0);
  std::size_t i = 0;
  for (; i + kParts <= size; i += kParts) {
    for (std::size_t p = 0; p < kParts; ++p) {
      const double change = relative_change(i + p);
      parts[p] = change < parts[p] ? change : parts[p];
    }
  }
  for (; i < size; ++i) parts[0] = std::min(parts[0], relative_change(i));
  return -1.0 / *std::min_element(parts, parts + kParts);
}

// Constraints ``G z <= space`` in the coordinates z_k of ``t_k = p_k + N_k z_k``, R each, those beyond r zero. The
// rows of G: upper limits, lower limits, rises and falls.
template <int R>
class PathProgram {
 public:
  explicit PathProgram(const PathConstraints& path)
      : path_(path), K_(path.samples), m_(path.m), size_((4 * K_ - 2) * m_), basis_(K_ * m_ * kRow) {
    for (std::size_t row = 0; row < K_ * m_; ++row) {
      std::copy_n(path.basis + row * path.r, path.r, basis_.data() + row * kRow);
    }
    for (auto* coordinates : {&z_, &slope_, &change_}) coordinates->resize(K_ * kRow);
    for (auto* rows : {&slack_, &inverse_slack_, &multipliers_, &weights_, &off_, &pull_, &product_change_,
                       &slack_change_, &multiplier_change_}) {
      rows->resize(size_);
    }
    factor_.resize(K_);
  }

  // Writes coordinates and multipliers as the steps leave them, and polished.
  void solve(const PathAnswer& answer) {
    for (std::size_t i = 0; i < size_; ++i) {
      slack_[i] = std::max(space(i), kStart);
      multipliers_[i] = kStart;
    }
    int iteration = 0;
    while (iteration < kIterationLimit && step()) ++iteration;
    *answer.iterations = iteration;
    store(answer.coordinates, answer.multipliers);
    polish();
    store(answer.polished_coordinates, answer.polished_multipliers);
  }

 private:
  using Numbers = std::vector<double>;
  static constexpr int kRowParts = (R + kWidth - 1) / kWidth;
  static constexpr int kRow = kRowParts * kWidth;
  using V = Lanes<double, kWidth>;

  double space(std::size_t i) const { return path_.space[i] + path_.relaxation; }
  const double* basis(std::size_t k, std::size_t i) const { return basis_.data() + (k * m_ + i) * kRow; }

  void store(double* coordinates, double* multipliers) const {
    for (std::size_t k = 0; k < K_; ++k) std::copy_n(z_.data() + k * kRow, path_.r, coordinates + k * path_.r);
    std::copy(multipliers_.begin(), multipliers_.end(), multipliers);
  }

  // G z.
  void rows(const Numbers& z, Numbers& out) const {
    double *upper = out.data(), *lower = upper + K_ * m_, *rise = lower + K_ * m_, *fall = rise + (K_ - 1) * m_;
    for (std::size_t k = 0; k < K_; ++k) {
      for (std::size_t i = 0; i < m_; ++i) {
        double t = 0.0;
        for (int a = 0; a < R; ++a) t += basis(k, i)[a] * z[k * kRow + a];
        upper[k * m_ + i] = t;
      }
    }
    for (std::size_t i = 0; i < K_ * m_; ++i) lower[i] = -upper[i];
    for (std::size_t i = 0; i < (K_ - 1) * m_; ++i) {
      rise[i] = upper[i + m_] - upper[i];
      fall[i] = -rise[i];
    }
  }

  // The number of each tension to which the rows of a sample's cables add up. Sign: of the rows that fall with it.
  void gather(const Numbers& rows, std::size_t k, double sign, double* out) const {
    const double *upper = rows.data() + k * m_, *lower = upper + K_ * m_;
    const double *rise = rows.data() + 2 * K_ * m_ + k * m_, *fall = rise + (K_ - 1) * m_;
    for (std::size_t i = 0; i < m_; ++i) out[i] = upper[i] + sign * lower[i];
    if (k > 0) {
      for (std::size_t i = 0; i < m_; ++i) out[i] += (rise - m_)[i] + sign * (fall - m_)[i];
    }
    if (k + 1 < K_) {
      for (std::size_t i = 0; i < m_; ++i) out[i] += sign * rise[i] + fall[i];
    }
  }

  // G' of a number for each constraint.
  void pull_back(const Numbers& rows, Numbers& out) const {
    double t[kMaxCables];
    for (std::size_t k = 0; k < K_; ++k) {
      gather(rows, k, -1.0, t);
      double* sums = out.data() + k * kRow;
      std::fill_n(sums, kRow, 0.0);
      for (std::size_t i = 0; i < m_; ++i) {
        for (int a = 0; a < R; ++a) sums[a] += t[i] * basis(k, i)[a];
      }
    }
  }

  // Numbers of a row, R and zeros.
  struct Row {
    V part[kRowParts] = {};

    void add(double weight, const double* numbers) {
      for (int q = 0; q < kRowParts; ++q) part[q] += weight * load<double, kWidth>(numbers + q * kWidth);
    }
    void add(double weight, const Row& row) {
      for (int q = 0; q < kRowParts; ++q) part[q] += weight * row.part[q];
    }
    double operator[](int b) const { return read<double>(part[b / kWidth], b % kWidth); }
  };

  // Block row of the matrix ``1 + G' diag(weights) G`` after elimination: diagonal and the block beside it.
  struct BlockRow {
    Row own[R], beside[R];
    double inverse[R];  // of the diagonal
  };

  // Eliminates the matrix block by block. False if rounding leaves it no longer definite.
  bool factor() {
    double t[kMaxCables];
    for (std::size_t k = 0; k < K_; ++k) {
      BlockRow row{};
      gather(weights_, k, 1.0, t);
      for (std::size_t i = 0; i < m_; ++i) {
        for (int a = 0; a < R; ++a) row.own[a].add(t[i] * basis(k, i)[a], basis(k, i));
      }
      if (k > 0) {
        const BlockRow& before = factor_[k - 1];
        for (int c = 0; c < R; ++c) {
          for (int a = 0; a < R; ++a) row.own[a].add(-before.inverse[c] * before.beside[c][a], before.beside[c]);
        }
      }
      if (k + 1 < K_) {
        const double* rise = weights_.data() + 2 * K_ * m_ + k * m_;
        const double* fall = rise + (K_ - 1) * m_;
        for (std::size_t i = 0; i < m_; ++i) {
          for (int a = 0; a < R; ++a) row.beside[a].add(-(rise[i] + fall[i]) * basis(k, i)[a], basis(k + 1, i));
        }
      }
      for (int a = 0; a < R; ++a) {
        const double diagonal = 1.0 + row.own[a][a];
        if (!(diagonal > 0.0)) return false;
        row.inverse[a] = 1.0 / diagonal;
        for (int c = a + 1; c < R; ++c) {
          const double ratio = -row.own[a][c] * row.inverse[a];
          row.own[c].add(ratio, row.own[a]);
          row.beside[c].add(ratio, row.beside[a]);
        }
      }
      factor_[k] = row;
    }
    return true;
  }

  // Solves for a right-hand side in place.
  void solve_in_place(Numbers& right) const {
    for (std::size_t k = 0; k < K_; ++k) {
      double* x = right.data() + k * kRow;
      Row left;
      left.add(1.0, x);
      for (int a = 0; k > 0 && a < R; ++a) {
        left.add(-factor_[k - 1].inverse[a] * (x - kRow)[a], factor_[k - 1].beside[a]);
      }
      for (int a = 0; a < R; ++a) {
        x[a] = left[a];
        left.add(-factor_[k].inverse[a] * x[a], factor_[k].own[a]);
      }
    }
    for (std::size_t k = K_; k-- > 0;) {
      double* x = right.data() + k * kRow;
      for (int a = R - 1; a >= 0; --a) {
        for (int b = 0; k + 1 < K_ && b < R; ++b) x[a] -= factor_[k].beside[a][b] * (x + kRow)[b];
      }
      for (int a = R - 1; a >= 0; --a) {
        for (int b = a + 1; b < R; ++b) x[a] -= factor_[k].own[a][b] * x[b];
        x[a] *= factor_[k].inverse[a];
      }
    }
  }

  // Whether the constraints times the multipliers, added up, contradict each other for all z inside the limits.
  bool contradicted() const {
    double reached = sum(size_, [&](std::size_t i) { return multipliers_[i] * space(i); });
    for (std::size_t k = 0; k < K_; ++k) {
      double square = 0.0;
      for (int a = 0; a < R; ++a) square += slope_[k * kRow + a] * slope_[k * kRow + a];
      reached += path_.reach[k] * std::sqrt(square);
    }
    return reached < 0.0;
  }

  // Computes the changes that lower the products of slack and multipliers by a target, to first order.
  template <class Target>
  void aim(const Target& target) {
    for (std::size_t i = 0; i < size_; ++i) pull_[i] = weights_[i] * off_[i] - target(i) * inverse_slack_[i];
    pull_back(pull_, change_);
    for (std::size_t i = 0; i < K_ * kRow; ++i) change_[i] = -slope_[i] - change_[i];
    solve_in_place(change_);
    rows(change_, pull_);
    for (std::size_t i = 0; i < size_; ++i) {
      const double slack = -off_[i] - pull_[i];
      multiplier_change_[i] = -(target(i) + multipliers_[i] * slack) * inverse_slack_[i];
      slack_change_[i] = slack;
    }
  }

  // Takes a step. False if nothing more can be gained.
  bool step() {
    const double mean = sum(size_, [&](std::size_t i) { return slack_[i] * multipliers_[i]; }) / count_;
    if (mean <= kAccuracy) return false;
    pull_back(multipliers_, slope_);
    if (contradicted()) return false;
    for (std::size_t i = 0; i < K_ * kRow; ++i) slope_[i] += z_[i];
    for (std::size_t i = 0; i < size_; ++i) {
      inverse_slack_[i] = 1.0 / slack_[i];
      weights_[i] = multipliers_[i] * inverse_slack_[i];
    }
    if (!factor()) return false;
    rows(z_, off_);
    for (std::size_t i = 0; i < size_; ++i) off_[i] += slack_[i] - space(i);

    aim([&](std::size_t i) { return slack_[i] * multipliers_[i]; });
    const double primal = slack_share(), dual = multiplier_share();
    const double ahead = sum(size_, [&](std::size_t i) {
      return (slack_[i] + primal * slack_change_[i]) * (multipliers_[i] + dual * multiplier_change_[i]);
    });
    const double aimed = ahead / count_, centre = aimed * aimed * aimed / (mean * mean);
    for (std::size_t i = 0; i < size_; ++i) {
      product_change_[i] = slack_change_[i] * multiplier_change_[i] - centre;
    }
    aim([&](std::size_t i) { return slack_[i] * multipliers_[i] + product_change_[i]; });
    move(std::min(1.0, kStepShare * slack_share()), std::min(1.0, kStepShare * multiplier_share()));
    return true;
  }

  double slack_share() const {
    return share(size_, [&](std::size_t i) { return slack_change_[i] * inverse_slack_[i]; });
  }
  double multiplier_share() const {
    return share(size_, [&](std::size_t i) { return multiplier_change_[i] / multipliers_[i]; });
  }

  void move(double primal, double dual) {
    for (std::size_t i = 0; i < K_ * kRow; ++i) z_[i] += primal * change_[i];
    for (std::size_t i = 0; i < size_; ++i) {
      slack_[i] += primal * slack_change_[i];
      multipliers_[i] += dual * multiplier_change_[i];
    }
  }

  // Solves the equations of the active constraints, not relaxed, by the method of multipliers.
  void polish() {
    for (std::size_t i = 0; i < size_; ++i) {
      const bool active = multipliers_[i] > slack_[i];
      weights_[i] = active ? kPolishingWeight : 0.0;
      if (!active) multipliers_[i] = 0.0;
    }
    if (!factor()) return;
    for (int round = 0; round < kPolishingSteps; ++round) {
      for (std::size_t i = 0; i < size_; ++i) pull_[i] = weights_[i] * path_.space[i] - multipliers_[i];
      pull_back(pull_, z_);
      solve_in_place(z_);
      rows(z_, off_);
      for (std::size_t i = 0; i < size_; ++i) {
        multipliers_[i] = std::max(multipliers_[i] + weights_[i] * (off_[i] - path_.space[i]), 0.0);
      }
    }
  }

  const PathConstraints& path_;
  const std::size_t K_, m_, size_;
  const double count_ = static_cast<double>(size_);
  std::vector<BlockRow> factor_;
  Numbers basis_;
  Numbers z_, slope_, change_;  // (K, kRow)
  // (4K - 2, m)
  Numbers slack_, inverse_slack_, multipliers_, weights_, off_, pull_, product_change_;
  Numbers slack_change_, multiplier_change_;
};

}  // namespace

void allocate_path(const PathConstraints& constraints, const PathAnswer& answer) {
  const auto solve = [&](auto width) { PathProgram<decltype(width)::value>(constraints).solve(answer); };
  if (constraints.r <= 2) return solve(std::integral_constant<int, 2>());
  if (constraints.r <= 3) return solve(std::integral_constant<int, 3>());
  if (constraints.r <= 4) return solve(std::integral_constant<int, 4>());
  if (constraints.r <= 5) return solve(std::integral_constant<int, 5>());
  if (constraints.r <= 6) return solve(std::integral_constant<int, 6>());
  if (constraints.r <= 8) return solve(std::integral_constant<int, 8>());
  if (constraints.r <= 16) return solve(std::integral_constant<int, 16>());
  solve(std::integral_constant<int, 32>());
}

}  // namespace tensionlab
