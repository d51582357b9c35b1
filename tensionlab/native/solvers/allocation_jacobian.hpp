// Derivatives of the tensions of one problem by its structure, wrench, limits and reference, at an answer of the
// exact solver.
//
// Some cables are free, F; the others are held at a limit. While that does not change, the tensions are smooth:
//
//   dt = P (s dw - dW tau - W_held dlimits) + K (dW'z + dreference) + dlimits
//
// with P and K zero outside the rows of F, and, with X the pseudo-inverse of D W_F:
//
// clang-format off
//              s  D                  P                      K               tau      z
//   render     1  1                  X                      I_F - P W_F     t        the multiplier y
//   force      1  root of weights    X D                    X X'            t        D'D r
//   tension    1  whitens W          X D                    X X' - P W      t + W'z  D'D r
//   direction  s  1                  X (1 - w d'/(d'w))     0               t        -
// clang-format on
//
// r = w - W t is the error, d the normal of the face that w is beyond. dreference counts for `render` alone. Where
// W has fewer cables than components, all independent, `tension` is W+ w, clipped: K = P W+', z = w - W W+ w.
//
// That is smooth only if the columns of F are independent and of the right number, and clear forces hold the
// others at their limits. Elsewhere there is a kink: the numbers are those for the cables as they are held, with
// the pseudo-inverse.
//
// Sources: Amos and Kolter (2017), "OptNet: differentiable optimization as a layer in neural networks", for the
// conditions of a quadratic program, differentiated; Golub and Pereyra (1973), "The differentiation of
// pseudo-inverses and nonlinear least squares problems whose variables separate", for what the free cables do.
#pragma once

#include <algorithm>
#include <cmath>

#include "tensionlab/simd/lane_problem.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// An answer of the exact solver and its status.
struct SolvedProblem {
  Problem<double> problem;
  const double* tensions;
  bool exact, proved;
  double scale;  // NaN where no scale keeps the direction
};

template <int N, int M>
class AllocationJacobian {
 public:
  AllocationJacobian(const SolvedProblem& solved, int m, Policy policy, const double* weights,
                     double rank_tolerance)
      : source_(solved.problem), t_(solved.tensions), m_(m), rank_tolerance_(rank_tolerance) {
    kink_ = !solved.proved;
    find_free();
    if (solved.exact) use_metric(nullptr);
    if (solved.exact && (rank_ == N || rank_ < count_ || policy == Policy::direction)) {
      render();
    } else if (policy == Policy::direction && std::isfinite(solved.scale)) {
      direction(solved.scale);
    } else if (policy == Policy::tension) {
      tension();
    } else {
      force(weights);
    }
  }

  bool kink() const { return kink_; }

  // d tensions / d wrench, m x n.
  void wrench(double* out) const {
    std::fill_n(out, m_ * N, 0.0);
    for (int f = 0; f < count_; ++f) {
      for (int k = 0; k < N; ++k) out[free_[f] * N + k] = scale_ * p_[f][k];
    }
  }

  // d tensions / d structure, m x n x m.
  void structure(double* out) const {
    std::fill_n(out, m_ * N * m_, 0.0);
    for (int f = 0; f < count_; ++f) {
      double row[M];
      k_row(f, row);
      double* own = out + free_[f] * N * m_;
      for (int k = 0; k < N; ++k) {
        for (int j = 0; j < m_; ++j) own[k * m_ + j] = row[j] * z_[k] - p_[f][k] * tau_[j];
      }
    }
  }

  // The sums over tensions of cotangent times derivative: by structure (n x m), wrench (n), limits and reference
  // (m).
  void pull_back(const double* cotangent, double* structure, double* wrench, double* lower, double* upper,
                 double* reference) const {
    double u[N] = {}, q[M];
    for (int f = 0; f < count_; ++f) {
      for (int k = 0; k < N; ++k) u[k] += p_[f][k] * cotangent[free_[f]];
    }
    k_transposed(cotangent, u, q);
    for (int k = 0; k < N; ++k) {
      wrench[k] = scale_ * u[k];
      for (int j = 0; j < m_; ++j) structure[k * m_ + j] = z_[k] * q[j] - u[k] * tau_[j];
    }
    for (int j = 0; j < m_; ++j) {
      const double held = side_[j] == 0 ? 0.0 : cotangent[j] - along(j, u);
      lower[j] = side_[j] < 0 ? held : 0.0;
      upper[j] = side_[j] > 0 ? held : 0.0;
      reference[j] = kind_ == Kind::projector ? q[j] : 0.0;
    }
  }

 private:
  // Kind of K, in the order of the table; `independent` is the remark below it.
  enum class Kind { projector, gram, gram_less, none, independent };

  // Distance from a limit below which a tension counts as at it, as a share of its range; and the share of its
  // largest size below which a force has no clear sign.
  static constexpr double kWeak = 1e-9;
  // A face whose normal has a cosine with w below this is grazed (solvers/scale_search.hpp).
  static constexpr double kGrazed = 1e-5;

  double entry(int k, int i) const { return source_.structure[k * m_ + i]; }
  double along(int i, const double* d) const {
    double sum = 0;
    for (int k = 0; k < N; ++k) sum += entry(k, i) * d[k];
    return sum;
  }
  double length(int i) const {
    double sum = 0;
    for (int k = 0; k < N; ++k) sum += entry(k, i) * entry(k, i);
    return std::sqrt(sum);
  }
  static double length(const double* d) { return std::sqrt(dot<N>(d, d)); }
  bool has_range(int i) const { return source_.lower[i] < source_.upper[i]; }

  void find_free() {
    for (int i = 0; i < m_; ++i) {
      const double near = kWeak * (source_.upper[i] - source_.lower[i]);
      side_[i] = t_[i] <= source_.lower[i] + near ? -1 : t_[i] >= source_.upper[i] - near ? 1 : 0;
      slot_[i] = side_[i] == 0 ? count_ : -1;
      if (side_[i] == 0) free_[count_++] = i;
    }
  }

  // X and P for the metric D, n x n row by row; null for the plain one.
  void use_metric(const double* d) {
    double columns[M][N];
    for (int f = 0; f < count_; ++f) {
      for (int k = 0; k < N; ++k) {
        columns[f][k] = d == nullptr ? entry(k, free_[f]) : 0.0;
        for (int l = 0; d != nullptr && l < N; ++l) columns[f][k] += d[k * N + l] * entry(l, free_[f]);
      }
    }
    invert(columns);
    for (int f = 0; f < count_; ++f) {
      for (int k = 0; k < N; ++k) {
        p_[f][k] = d == nullptr ? x_[f][k] : 0.0;
        for (int l = 0; d != nullptr && l < N; ++l) p_[f][k] += x_[f][l] * d[l * N + k];
      }
    }
  }

  // X, the pseudo-inverse of the free columns; of fewer columns than components by the transpose, whose rows are
  // then mostly independent.
  void invert(const double (*columns)[N]) {
    if (count_ < N) {
      const Whitening<double, N, N> whitening(columns[0], count_, N, rank_tolerance_);
      rank_ = whitening.rank;
      pseudoinverse(
          whitening, count_, N, [&](int f, int k) { return columns[f][k]; },
          [&](int k, int f) -> double& { return x_[f][k]; });
      return;
    }
    double rows[N * M];
    for (int k = 0; k < N; ++k) {
      for (int f = 0; f < count_; ++f) rows[k * count_ + f] = columns[f][k];
    }
    const Whitening<double, N, M> whitening(rows, N, count_, rank_tolerance_);
    rank_ = whitening.rank;
    pseudoinverse(
        whitening, N, count_, [&](int k, int f) { return columns[f][k]; },
        [&](int f, int k) -> double& { return x_[f][k]; });
  }

  // out(i, k) = (B A)'B of a matrix A, n x m, whose rows B makes orthonormal.
  template <class Whitener, class Matrix, class Out>
  static void pseudoinverse(const Whitener& b, int n, int m, const Matrix& a, const Out& out) {
    for (int i = 0; i < m; ++i) {
      double white[N] = {};
      for (int r = 0; r < b.rank; ++r) {
        white[r] = 0;
        for (int k = 0; k < n; ++k) white[r] += b.rows[r][k] * a(k, i);
      }
      for (int k = 0; k < n; ++k) {
        out(i, k) = 0;
        for (int r = 0; r < b.rank; ++r) out(i, k) += white[r] * b.rows[r][k];
      }
    }
  }

  // The wrench is rendered, by tensions closest to the reference.
  void render() {
    kind_ = Kind::projector;
    kink_ = kink_ || rank_ < N;
    std::fill_n(z_, N, 0.0);
    for (int f = 0; f < count_; ++f) {
      const double change = t_[free_[f]] - source_.reference[free_[f]];
      for (int k = 0; k < N; ++k) z_[k] += x_[f][k] * change;
    }
    for (int i = 0; i < m_; ++i) {
      tau_[i] = t_[i];
      const double wanted = source_.reference[i] + along(i, z_);
      hold(i, wanted - (side_[i] < 0 ? source_.lower[i] : source_.upper[i]),
           kWeak * (source_.upper[i] - source_.lower[i]));
    }
  }

  void force(const double* weights) {
    double d[N * N] = {};
    for (int k = 0; k < N; ++k) d[k * N + k] = std::sqrt(weights[k]);
    use_metric(d);
    nearest(d);
    std::copy_n(t_, m_, tau_);
    kind_ = Kind::gram;
    finish_dependent();
  }

  void tension() {
    const Whitening<double, N, M> whitening(source_.structure, N, m_, rank_tolerance_);
    double d[N * N] = {};
    for (int r = 0; r < whitening.rank; ++r) std::copy_n(whitening.rows[r], N, d + r * N);
    use_metric(d);
    nearest(d);
    for (int i = 0; i < m_; ++i) tau_[i] = t_[i] + along(i, z_);
    kind_ = Kind::gram_less;
    if (whitening.rank < N && whitening.rank == m_) return render_apart(whitening);
    kink_ = kink_ || whitening.rank < N;
    finish_dependent();
  }

  // z and the forces on the held cables, where tensions come nearest to the wrench. If it is rendered, the signs
  // of these forces are unclear.
  void nearest(const double* d) {
    double error[N], whitened[N], size = 0;
    for (int k = 0; k < N; ++k) {
      error[k] = source_.wrench[k];
      double sum = std::abs(error[k]);
      for (int i = 0; i < m_; ++i) {
        error[k] -= entry(k, i) * t_[i];
        sum += std::abs(entry(k, i) * t_[i]);
      }
      size += sum;
    }
    const bool none = length(error) <= kWeak * size;
    for (int r = 0; r < N; ++r) {
      whitened[r] = 0;
      for (int k = 0; k < N; ++k) whitened[r] += d[r * N + k] * error[k];
    }
    for (int k = 0; k < N; ++k) {
      z_[k] = 0;
      for (int r = 0; r < N; ++r) z_[k] += d[r * N + k] * whitened[r];
    }
    for (int i = 0; i < m_; ++i) hold(i, none ? 0.0 : along(i, z_), kWeak * length(i) * length(z_));
  }

  // Fewer cables than components, all independent: W+ w.
  void render_apart(const Whitening<double, N, M>& whitening) {
    kind_ = Kind::independent;
    pseudoinverse(
        whitening, N, m_, [&](int k, int i) { return entry(k, i); },
        [&](int i, int k) -> double& { return inverse_[i][k]; });
    std::copy_n(source_.wrench, N, z_);
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < m_; ++i) z_[k] -= entry(k, i) * tau_[i];
    }
  }

  // Free cables that are dependent, or leave no error, have no derivative by the structure.
  void finish_dependent() {
    if (rank_ == count_ && rank_ < N) return;
    kink_ = true;
    kind_ = Kind::projector;
    std::fill_n(z_, N, 0.0);
    std::copy_n(t_, m_, tau_);
  }

  // s w is on a face.
  void direction(double scale) {
    use_metric(nullptr);
    kind_ = Kind::none;
    scale_ = scale;
    std::fill_n(z_, N, 0.0);
    std::copy_n(t_, m_, tau_);
    double d[N];
    normal(d);
    double towards = dot<N>(d, source_.wrench);
    if (towards < 0) {
      for (int k = 0; k < N; ++k) d[k] = -d[k];
      towards = -towards;
    }
    kink_ = kink_ || rank_ != N - 1 || count_ != N - 1 || !(scale > 0) ||
            !(towards > kGrazed * length(source_.wrench));
    for (int i = 0; i < m_; ++i) hold(i, along(i, d), kWeak * length(i));
    if (!(towards > 0)) return;
    for (int f = 0; f < count_; ++f) {
      const double sum = dot<N>(p_[f], source_.wrench);
      for (int k = 0; k < N; ++k) p_[f][k] -= sum * d[k] / towards;
    }
  }

  // A unit vector perpendicular to the free columns: the longest projection of an axis by 1 - W_F X.
  void normal(double* d) const {
    double rest[N][N];
    int best = 0;
    for (int l = 0; l < N; ++l) {
      for (int k = 0; k < N; ++k) {
        rest[l][k] = k == l ? 1.0 : 0.0;
        for (int f = 0; f < count_; ++f) rest[l][k] -= entry(k, free_[f]) * x_[f][l];
      }
      if (length(rest[l]) > length(rest[best])) best = l;
    }
    const double size = length(rest[best]);
    for (int k = 0; k < N; ++k) d[k] = size > 0 ? rest[best][k] / size : 0.0;
  }

  // Checks the force that pushes cable i beyond its limit, upwards if positive; up to `weak` its sign is unclear.
  void hold(int i, double push, double weak) {
    if (side_[i] == 0) return;
    if (!has_range(i)) {
      side_[i] = push > 0 ? 1 : -1;
    } else if (!(side_[i] * push > weak)) {
      kink_ = true;
    }
  }

  // Row f of K.
  void k_row(int f, double* row) const {
    for (int j = 0; j < m_; ++j) {
      const int g = slot_[j];
      row[j] = 0;
      if (kind_ == Kind::independent) {
        row[j] = dot<N>(p_[f], inverse_[j]);
        continue;
      }
      if (g >= 0 && kind_ == Kind::projector) row[j] = (f == g ? 1.0 : 0.0) - along(j, p_[f]);
      if (g >= 0 && (kind_ == Kind::gram || kind_ == Kind::gram_less)) {
        row[j] = dot<N>(x_[f], x_[g]);
      }
      if (kind_ == Kind::gram_less) row[j] -= along(j, p_[f]);
    }
  }

  // K' times a cotangent; u is P' times it.
  void k_transposed(const double* cotangent, const double* u, double* q) const {
    double v[N] = {};
    for (int f = 0; f < count_; ++f) {
      for (int k = 0; k < N; ++k) v[k] += x_[f][k] * cotangent[free_[f]];
    }
    for (int j = 0; j < m_; ++j) {
      const int g = slot_[j];
      q[j] = 0;
      if (kind_ == Kind::independent) {
        q[j] = dot<N>(inverse_[j], u);
        continue;
      }
      if (g >= 0 && kind_ == Kind::projector) q[j] = cotangent[j] - along(j, u);
      if (g >= 0 && (kind_ == Kind::gram || kind_ == Kind::gram_less)) {
        q[j] = dot<N>(x_[g], v);
      }
      if (kind_ == Kind::gram_less) q[j] -= along(j, u);
    }
  }

  Problem<double> source_;
  const double* t_;
  int m_;
  double rank_tolerance_, scale_ = 1;
  bool kink_ = false;
  Kind kind_ = Kind::none;
  int count_ = 0, rank_ = 0;
  int free_[M], slot_[M], side_[M];  // the free cables; their places there, or -1; the limit: -1 lower, 1 upper
  double x_[M][N], p_[M][N], inverse_[M][N];
  double tau_[M], z_[N];
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
