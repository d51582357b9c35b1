// Pose of a platform from its cable lengths, starting at the pose a moment ago: the Gauss-Newton method on the
// twist, as in tensionlab/model/kinematics.py.
//
// The derivative of the lengths is -W' (W: structure matrix). What the known lengths do not determine stays as it
// was: the step is the shortest one, by the eigenvalues of W W'.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "workspace/pulley.hpp"

namespace tensionlab {

constexpr int kMaxDof = 6;
// Eigenvalues of W W' below this share of the largest count as zero: the square of the share for singular values.
constexpr double kSmallestShare = 1e-12;
constexpr int kJacobiSweeps = 30;
constexpr double kPi = 3.14159265358979323846;
constexpr double kRounding = 1e-6;  // rad: a more negative arc has wrapped around the pulley

using Vector = std::array<double, kMaxDof>;
using Matrix = std::array<Vector, kMaxDof>;

// The shortest least-squares solution x of A x = b, for a symmetric A without negative eigenvalues, by Jacobi
// rotations (Golub and Van Loan, section 8.5).
inline Vector shortest_solution(Matrix a, const Vector& b, int n) {
  Matrix v{};
  for (int i = 0; i < n; ++i) v[i][i] = 1.0;
  for (int sweep = 0; sweep < kJacobiSweeps; ++sweep) {
    double off = 0.0, diagonal = 0.0;
    for (int i = 0; i < n; ++i) {
      diagonal += a[i][i] * a[i][i];
      for (int j = i + 1; j < n; ++j) off += a[i][j] * a[i][j];
    }
    if (off <= 1e-34 * diagonal) break;
    for (int p = 0; p < n; ++p) {
      for (int q = p + 1; q < n; ++q) {
        if (a[p][q] == 0.0) continue;
        const double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
        const double t = std::copysign(1.0, theta) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
        const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
        for (int k = 0; k < n; ++k) {
          const double kp = a[k][p], kq = a[k][q];
          a[k][p] = c * kp - s * kq;
          a[k][q] = s * kp + c * kq;
        }
        for (int k = 0; k < n; ++k) {
          const double pk = a[p][k], qk = a[q][k];
          a[p][k] = c * pk - s * qk;
          a[q][k] = s * pk + c * qk;
        }
        for (int k = 0; k < n; ++k) {
          const double kp = v[k][p], kq = v[k][q];
          v[k][p] = c * kp - s * kq;
          v[k][q] = s * kp + c * kq;
        }
      }
    }
  }
  double largest = 0.0;
  for (int i = 0; i < n; ++i) largest = std::max(largest, a[i][i]);
  Vector x{};
  for (int i = 0; i < n; ++i) {
    if (a[i][i] <= kSmallestShare * largest) continue;
    double along = 0.0;
    for (int k = 0; k < n; ++k) along += v[k][i] * b[k];
    for (int k = 0; k < n; ++k) x[k] += v[k][i] * along / a[i][i];
  }
  return x;
}

class PoseTracker {
 public:
  // Anchors, attachments and axes of pulleys are (m, d), row by row, radii of pulleys (m). A rig that cannot turn
  // has no attachments, one without pulleys no radii and axes.
  PoseTracker(std::vector<double> anchors, std::vector<double> attachments, std::vector<double> position,
              std::vector<double> radii, std::vector<double> axes)
      : anchors_(std::move(anchors)),
        attachments_(std::move(attachments)),
        position_(std::move(position)),
        radii_(std::move(radii)),
        axes_(std::move(axes)) {
    d_ = static_cast<int>(position_.size());
    m_ = static_cast<int>(anchors_.size()) / d_;
    n_ = attachments_.empty() ? d_ : 3 * (d_ - 1);
    for (int i = 0; i < 3; ++i) rotation_[i][i] = 1.0;
    residuals_.resize(static_cast<std::size_t>(m_));
    lengths_.resize(static_cast<std::size_t>(m_));
    arms_.resize(static_cast<std::size_t>(m_));
    structure_.resize(static_cast<std::size_t>(n_ * m_));
  }

  int cables() const { return m_; }
  int dof() const { return n_; }
  int dimension() const { return d_; }
  const std::vector<double>& position() const { return position_; }
  const std::array<std::array<double, 3>, 3>& rotation() const { return rotation_; }
  const std::vector<double>& structure() const { return structure_; }
  const std::vector<double>& residuals() const { return residuals_; }

  // Follows the known lengths in at most this many steps, until one is shorter than the tolerance.
  void follow(const double* lengths, const bool* known, int steps, double tolerance) {
    update(lengths, known);
    for (int step = 0; step < steps; ++step) {
      const Vector twist = velocity(residuals_.data(), known);
      move(twist);
      update(lengths, known);
      double longest = 0.0;
      for (int i = 0; i < n_; ++i) longest = std::max(longest, std::abs(twist[i]));
      if (longest < tolerance) break;
    }
  }

  // The twist that fits the known speeds of paying out best, at the latest pose.
  Vector velocity(const double* speeds, const bool* known) const {
    Matrix normal{};
    Vector right{};
    for (int cable = 0; cable < m_; ++cable) {
      if (!known[cable]) continue;
      for (int i = 0; i < n_; ++i) {
        right[i] -= entry(i, cable) * speeds[cable];
        for (int j = 0; j < n_; ++j) normal[i][j] += entry(i, cable) * entry(j, cable);
      }
    }
    return shortest_solution(normal, right, n_);
  }

  double entry(int row, int cable) const { return structure_[static_cast<std::size_t>(row * m_ + cable)]; }

  // The change of the force of these tensions by a small twist of the platform, which turns the cables.
  double force_change(const Vector& twist, const double* tensions) const {
    double change[3] = {0.0, 0.0, 0.0};
    for (int cable = 0; cable < m_; ++cable) {
      const auto index = static_cast<std::size_t>(cable);
      if (!(tensions[cable] > 0.0)) continue;
      const std::array<double, 3>& arm = arms_[index];
      double motion[3] = {twist[0], twist[1], d_ == 3 ? twist[2] : 0.0}, along = 0.0;
      if (n_ == 6) {
        for (int i = 0; i < 3; ++i) {
          const int j = (i + 1) % 3, k = (i + 2) % 3;
          motion[i] +=
              twist[static_cast<std::size_t>(3 + j)] * arm[k] - twist[static_cast<std::size_t>(3 + k)] * arm[j];
        }
      } else if (n_ > d_) {
        motion[0] -= twist[2] * arm[1];
        motion[1] += twist[2] * arm[0];
      }
      for (int i = 0; i < d_; ++i) along += entry(i, cable) * motion[i];
      for (int i = 0; i < d_; ++i) {
        change[i] -= tensions[cable] / lengths_[index] * (motion[i] - along * entry(i, cable));
      }
    }
    return std::sqrt(change[0] * change[0] + change[1] * change[1] + change[2] * change[2]);
  }

 private:
  // Updates the structure matrix at the pose, and the residuals of the lengths measured; zero where unknown.
  void update(const double* lengths, const bool* known) {
    const auto at = [this](const std::vector<double>& rows, int cable, int axis) {
      return rows[static_cast<std::size_t>(cable * d_ + axis)];
    };
    for (int cable = 0; cable < m_; ++cable) {
      double arm[3] = {0.0, 0.0, 0.0}, u[3] = {0.0, 0.0, 0.0};
      for (int i = 0; i < d_; ++i) {
        if (!attachments_.empty()) {
          for (int j = 0; j < d_; ++j) arm[i] += rotation_[i][j] * at(attachments_, cable, j);
        }
        u[i] = at(anchors_, cable, i) - position_[static_cast<std::size_t>(i)] - arm[i];
      }
      const double length = route(cable, u);
      lengths_[static_cast<std::size_t>(cable)] = length;
      arms_[static_cast<std::size_t>(cable)] = {arm[0], arm[1], arm[2]};
      for (int i = 0; i < d_; ++i) set(i, cable, u[i]);
      if (n_ == 6) {
        for (int i = 0; i < 3; ++i) {
          const int j = (i + 1) % 3, k = (i + 2) % 3;
          set(3 + i, cable, arm[j] * u[k] - arm[k] * u[j]);
        }
      } else if (n_ > d_) {
        set(2, cable, arm[0] * u[1] - arm[1] * u[0]);
      }
      residuals_[static_cast<std::size_t>(cable)] = known[cable] ? lengths[cable] - length : 0.0;
    }
  }

  // Turns u, from attachment to anchor, into the unit vector along the cable; returns its length from the anchor.
  double route(int cable, double (&u)[3]) const {
    if (!radii_.empty()) {
      const double radius = radii_[static_cast<std::size_t>(cable)];
      const double* axis = axes_.data() + static_cast<std::size_t>(cable * d_);
      const auto root = [](double x) { return std::sqrt(x); };
      const auto choose = [](bool test, double yes, double no) { return test ? yes : no; };
      const auto arc = route_over_pulley(u, d_, radius, axis, root, choose);
      double angle = std::atan2(arc.sine, arc.cosine);
      if (angle < -kRounding) angle += 2.0 * kPi;
      return arc.straight + radius * angle;
    }
    const double length = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (int i = 0; i < d_; ++i) u[i] /= std::max(length, std::numeric_limits<double>::min());
    return length;
  }

  void set(int row, int cable, double value) { structure_[static_cast<std::size_t>(row * m_ + cable)] = value; }

  // Moves the platform by a small twist; it turns by the exponential map (Rodrigues).
  void move(const Vector& twist) {
    for (int i = 0; i < d_; ++i) position_[static_cast<std::size_t>(i)] += twist[static_cast<std::size_t>(i)];
    if (n_ == d_) return;
    const double x = d_ == 3 ? twist[3] : 0.0, y = d_ == 3 ? twist[4] : 0.0, z = d_ == 3 ? twist[5] : twist[2];
    const double angle = std::sqrt(x * x + y * y + z * z);
    const double s = angle > 1e-8 ? std::sin(angle) / angle : 1.0;
    const double half = angle > 1e-8 ? std::sin(0.5 * angle) / (0.5 * angle) : 1.0;
    const double c = 0.5 * half * half;
    const double k[3][3] = {{0.0, -z, y}, {z, 0.0, -x}, {-y, x, 0.0}};
    std::array<std::array<double, 3>, 3> turned{};
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        double turn[3];
        for (int l = 0; l < 3; ++l) {
          double square = 0.0;
          for (int q = 0; q < 3; ++q) square += k[i][q] * k[q][l];
          turn[l] = (i == l ? 1.0 : 0.0) + s * k[i][l] + c * square;
        }
        for (int l = 0; l < 3; ++l) turned[i][j] += turn[l] * rotation_[l][j];
      }
    }
    rotation_ = turned;
  }

  std::vector<double> anchors_, attachments_, position_, radii_, axes_, residuals_, structure_, lengths_;
  std::vector<std::array<double, 3>> arms_;
  std::array<std::array<double, 3>, 3> rotation_{};
  int d_, m_, n_;
};

}  // namespace tensionlab
