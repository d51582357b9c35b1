// Consistency of the lengths of all cables, and detection of one that has drifted.
//
// With more cables than unknowns there are residuals. A bias b of cable i appears in its own as s_i b, where s_i,
// from 0 to 1, is the share that the other cables determine; the residual over s_i, both averaged over some time,
// is the least squares estimate of b. A cable is in doubt where this estimate, in standard deviations of a
// residual (over the root of s_i), is above a threshold: that at which the bias changes the rendered force by
// kMaxForceError. This is integrity monitoring as in satellite navigation (RAIM): Parkinson and Axelrad 1988,
// Navigation 35(2), for the test; Brown 1992, Navigation 39(3), for the protection level, the largest error that
// an undetected bias can cause at the present geometry, which grows without bound near singular poses.
//
// A length must also agree with the integral of the cable's own speed: the creep is the difference.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "hardware/pose_tracker.hpp"

namespace tensionlab {

constexpr double kMaxForceError = 0.5;     // N: error of the force by a bias that is not in doubt
constexpr double kMinLengthDoubt = 0.008;  // m: residuals below this are noise
constexpr double kMaxLengthDoubt = 0.04;   // m: residuals above this are in doubt, whatever their effect
constexpr double kLengthDoubtTime = 0.25;  // s: time constant of the averages
constexpr double kReferenceTime = 0.5;     // s: the residuals of this time are due to the calibration
constexpr double kMaxSpeedResidual = 0.3;  // m/s: above this a slack cable is taken up
constexpr double kCreepTime = 10.0;        // s: time constant of the decay of a creep
constexpr double kMaxCreepSpeed = 0.25;    // m/s: faster changes are jumps, which are detected elsewhere
constexpr double kMaxCheckPeriod = 0.1;    // s: after a longer pause lengths are not compared
constexpr double kMinLeverage = 1e-9;      // s_i below which the others determine nothing

class LengthCheck {
 public:
  // Largest estimate over its threshold; largest creep in m.
  struct Result {
    double doubt, creep;
  };

  explicit LengthCheck(std::size_t cables)
      : known_(cables),
        residuals_(cables),
        shares_(cables),
        reference_(cables),
        lengths_(cables),
        speeds_(cables),
        doubts_(cables),
        creeps_(cables),
        motions_(cables) {}

  std::size_t size() const { return known_.size(); }
  const std::vector<double>& doubts() const { return doubts_; }
  const std::vector<double>& creeps() const { return creeps_; }
  // Deviation of a cable's length from the others, in standard deviations, if that of a length is 1 m.
  double residual(std::size_t cable) const {
    return std::abs(residuals_[cable]) / std::sqrt(std::max(shares_[cable], kMinLeverage));
  }
  // Estimate of a cable's bias in m.
  double bias(std::size_t cable) const { return residuals_[cable] / std::max(shares_[cable], kMinLeverage); }

  // Takes the lengths that the tracker followed last, the given time after those before.
  Result update(const PoseTracker& tracker, const double* lengths, const double* speeds, const double* tensions,
                const bool* known, double seconds) {
    if (!std::equal(known_.begin(), known_.end(), known, [](char a, bool b) { return (a != 0) == b; }))
      reset(known);
    Result result{0.0, creep(lengths, speeds, seconds)};
    std::fill(doubts_.begin(), doubts_.end(), 0.0);
    solved_ = solve_motions(tracker);
    if (!solved_) return result;
    average(tracker, speeds, std::min(seconds, kMaxCheckPeriod));
    for (std::size_t i = 0; i < size(); ++i) {
      if (!known_[i]) continue;
      if (settled_ >= kReferenceTime) doubts_[i] = residual(i) / threshold(force_change(tracker, i, tensions));
      result.doubt = std::max(result.doubt, doubts_[i]);
    }
    return result;
  }

  // The largest change of the force in N by a bias that is not in doubt, at these tensions and the latest pose.
  double protection(const PoseTracker& tracker, const double* tensions) const {
    if (!solved_) return std::numeric_limits<double>::infinity();
    double largest = 0.0;
    for (std::size_t i = 0; i < size(); ++i) {
      if (!known_[i]) continue;
      const double force = force_change(tracker, i, tensions);
      largest = std::max(largest, force * threshold(force));
    }
    return largest;
  }

 private:
  // Change of the force by a bias of a cable, in N/m of a bias in standard deviations, if one is 1 m.
  double force_change(const PoseTracker& tracker, std::size_t cable, const double* tensions) const {
    return tracker.force_change(motions_[cable], tensions) / std::sqrt(std::max(shares_[cable], kMinLeverage));
  }

  // Bias in m from which on a cable is in doubt, by its change of the force in N/m.
  static double threshold(double force) {
    return std::clamp(kMaxForceError / std::max(force, 1e-9), kMinLengthDoubt, kMaxLengthDoubt);
  }

  void reset(const bool* known) {
    std::copy(known, known + size(), known_.begin());
    std::fill(residuals_.begin(), residuals_.end(), 0.0);
    std::fill(shares_.begin(), shares_.end(), 1.0);
    std::fill(reference_.begin(), reference_.end(), 0.0);
    std::fill(creeps_.begin(), creeps_.end(), 0.0);
    settled_ = 0.0;
    first_ = true;
  }

  double creep(const double* lengths, const double* speeds, double seconds) {
    double largest = 0.0;
    for (std::size_t i = 0; i < size(); ++i) {
      if (!known_[i]) continue;
      const double jump = lengths[i] - lengths_[i] - 0.5 * (speeds[i] + speeds_[i]) * seconds;
      const double most = kMaxCreepSpeed * seconds;
      if (!first_ && seconds < kMaxCheckPeriod) {
        creeps_[i] += std::clamp(jump, -most, most) - creeps_[i] * seconds / kCreepTime;
      }
      lengths_[i] = lengths[i];
      speeds_[i] = speeds[i];
      largest = std::max(largest, std::abs(creeps_[i]));
    }
    first_ = false;
    return largest;
  }

  // Motions of the platform by a bias of 1 m of each cable, (W W')^-1 W. False at a singular pose, or without more
  // cables than unknowns.
  bool solve_motions(const PoseTracker& tracker) {
    const int n = tracker.dof();
    if (std::count(known_.begin(), known_.end(), 1) <= n) return false;
    Matrix lower{};
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j <= i; ++j) {
        double sum = 0.0, whole = 0.0;
        for (std::size_t k = 0; k < size(); ++k) {
          if (known_[k]) sum += tracker.entry(i, static_cast<int>(k)) * tracker.entry(j, static_cast<int>(k));
        }
        whole = sum;
        for (int k = 0; k < j; ++k) sum -= lower[i][k] * lower[j][k];
        if (i == j && !(sum > kSmallestShare * whole)) return false;
        lower[i][j] = i == j ? std::sqrt(sum) : sum / lower[j][j];
      }
    }
    for (std::size_t k = 0; k < size(); ++k) {
      Vector& x = motions_[k];
      x = {};
      if (!known_[k]) continue;
      for (int i = 0; i < n; ++i) {
        x[i] = tracker.entry(i, static_cast<int>(k));
        for (int j = 0; j < i; ++j) x[i] -= lower[i][j] * x[j];
        x[i] /= lower[i][i];
      }
      for (int i = n - 1; i >= 0; --i) {
        for (int j = i + 1; j < n; ++j) x[i] -= lower[j][i] * x[j];
        x[i] /= lower[i][i];
      }
    }
    return true;
  }

  // The part of these numbers, one for each cable, that no motion of the platform explains.
  void project(const PoseTracker& tracker, const double* numbers, double* rest) const {
    Vector twist{};
    for (std::size_t k = 0; k < size(); ++k) {
      if (!known_[k]) continue;
      for (int i = 0; i < tracker.dof(); ++i) twist[i] += motions_[k][i] * numbers[k];
    }
    for (std::size_t k = 0; k < size(); ++k) {
      rest[k] = 0.0;
      if (!known_[k]) continue;
      rest[k] = numbers[k];
      for (int i = 0; i < tracker.dof(); ++i) rest[k] -= tracker.entry(i, static_cast<int>(k)) * twist[i];
    }
  }

  void average(const PoseTracker& tracker, const double* speeds, double seconds) {
    std::vector<double>& rest = rest_;
    rest.resize(size());
    project(tracker, speeds, rest.data());
    double squares = 0.0;
    for (const double speed : rest) squares += speed * speed;
    if (!(squares < kMaxSpeedResidual * kMaxSpeedResidual)) return;
    if (settled_ < kReferenceTime) {
      settled_ += seconds;
      for (std::size_t i = 0; i < size(); ++i) {
        reference_[i] += (tracker.residuals()[i] - reference_[i]) * seconds / settled_;
      }
      return;
    }
    project(tracker, reference_.data(), rest.data());
    const double part = std::min(seconds / kLengthDoubtTime, 1.0);
    for (std::size_t i = 0; i < size(); ++i) {
      if (!known_[i]) continue;
      double share = 1.0;
      for (int j = 0; j < tracker.dof(); ++j) {
        share -= tracker.entry(j, static_cast<int>(i)) * motions_[i][static_cast<std::size_t>(j)];
      }
      residuals_[i] += part * (tracker.residuals()[i] - rest[i] - residuals_[i]);
      shares_[i] += part * (share - shares_[i]);
    }
  }

  std::vector<char> known_;
  std::vector<double> residuals_, shares_, reference_, lengths_, speeds_, doubts_, creeps_, rest_;
  std::vector<Vector> motions_;
  double settled_ = 0.0;
  bool first_ = true, solved_ = false;
};

}  // namespace tensionlab
