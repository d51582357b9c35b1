// Choice of the brakes to lock for each wall: the cheapest small set of the cables that may be locked, by the rule
// of tensionlab/haptics/rendering/brakes.py.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "solvers/kernels.hpp"

namespace tensionlab {

// Walls: structure (size, n, m), normal (size, n), force and stiffness_ratio (size), pushing (size), held (size,
// m); lower, upper and stronger (m): the motors' limits, and the upper ones with a locked brake; brake (m):
// whether the module has one.
struct Walls {
  Batch motors;  // structure, normal as wrench, lower, upper
  const double *force, *stiffness_ratio, *stronger;
  const bool *pushing, *held, *brake;
};

struct LockRule {
  double margin;
  int most;
  double price, hysteresis, negligible;
};

struct LockAnswer {
  bool *locked, *available;
  double *tensions, *unresisted;
};

class LockSets {
 public:
  using Set = std::uint32_t;  // a bit for each cable
  static_assert(kMaxCables <= 32);

  LockSets(const Walls& walls, const LockRule& rule, double rank_tolerance, const LockAnswer& answer)
      : walls_(walls), rule_(rule), rank_tolerance_(rank_tolerance), answer_(answer), m_(walls.motors.m) {}

  void choose(std::size_t wall) {
    const double* normal = walls_.motors.wrench[wall];
    const double force = walls_.force[wall];
    structure_ = walls_.motors.structure[wall];
    for (int k = 0; k < walls_.motors.n; ++k) desired_[k] = force * normal[k];
    const std::size_t first = wall * static_cast<std::size_t>(m_);
    Set may = 0, held = 0;
    for (int i = 0; i < m_; ++i) {
      const bool own = walls_.held[first + static_cast<std::size_t>(i)];
      double outward = 0;
      for (int k = 0; k < walls_.motors.n; ++k) outward += structure_[k * m_ + i] * normal[k];
      const bool available = walls_.brake[i] && outward > (own ? 0.0 : rule_.margin);
      answer_.available[first + static_cast<std::size_t>(i)] = available;
      if (own) held |= Set{1} << i;
      if (available && force > 0 && (walls_.pushing[wall] || own)) may |= Set{1} << i;
    }

    best_ = std::numeric_limits<double>::infinity();
    sets_.assign(1, 0);
    price(0, held, force, wall);
    if (best_ > negligible(force)) {
      // No set costs less than its locks, which may already be more than the best so far.
      const double bonus = held != 0 ? rule_.hysteresis : 0.0;
      for (int size = 1; size <= rule_.most && best_ > (rule_.price * size - bonus) * force; ++size) {
        grow(may, walls_.stiffness_ratio[wall]);
        if (sets_.empty()) break;
        price(size, held, force, wall);
      }
    }
  }

 private:
  double negligible(double force) const { return rule_.negligible * std::fmax(1.0, force); }

  // Replaces the sets by those with one more cable, a later one each. A set that is too stiff only becomes
  // stiffer.
  void grow(Set may, double stiffness_ratio) {
    larger_.clear();
    for (const Set set : sets_) {
      for (int i = 0; i < m_; ++i) {
        const Set with = set | Set{1} << i;
        if ((may >> i & 1) == 0 || set >> i != 0) continue;
        if (stiffness_ratio == std::numeric_limits<double>::infinity() || stiffest(with) <= stiffness_ratio) {
          larger_.push_back(with);
        }
      }
    }
    sets_.swap(larger_);
  }

  // The largest row sum of |U_L' U_L|, which bounds the largest eigenvalue of U_L U_L' (Gershgorin).
  double stiffest(Set set) const {
    double most = 0;
    for (int i = 0; i < m_; ++i) {
      double sum = 0;
      for (int j = 0; j < m_ && (set >> i & 1) != 0; ++j) {
        double cosine = 0;
        for (int k = 0; k < walls_.motors.n; ++k) cosine += structure_[k * m_ + i] * structure_[k * m_ + j];
        if (set >> j & 1) sum += std::abs(cosine);
      }
      most = std::fmax(most, sum);
    }
    return most;
  }

  // Solves for all sets, which are of one size, and keeps the cheapest if it is cheaper than the best so far.
  void price(int size, Set held, double force, std::size_t wall) {
    const std::size_t count = sets_.size(), m = static_cast<std::size_t>(m_);
    const auto n = static_cast<std::size_t>(walls_.motors.n);
    upper_.resize(count * m);
    tensions_.resize(count * m);
    separation_.resize(count * n);
    iterations_.resize(count);
    for (std::size_t row = 0; row < count; ++row) {
      for (std::size_t i = 0; i < m; ++i) {
        upper_[row * m + i] = sets_[row] >> i & 1 ? walls_.stronger[i] : walls_.motors.upper[0][i];
      }
    }
    const Rows lower{walls_.motors.lower[0], 0};
    const Batch batch{
        count, walls_.motors.n,      m_, {structure_, 0}, {desired_, 0}, lower, {upper_.data(), walls_.motors.m},
        lower, walls_.motors.weights};
    newton_for_this_processor()(batch, Policy::force, rank_tolerance_, 0.0, {0, count}, 0,
                                {tensions_.data(), separation_.data(), iterations_.data()});
    for (std::size_t row = 0; row < count; ++row) {
      const double error = error_of(tensions_.data() + row * m);
      const double bonus = held != 0 && sets_[row] == held ? rule_.hysteresis : 0.0;
      const double cost = error + (rule_.price * size - bonus) * force;
      if (!(cost < best_ - negligible(force))) continue;  // among equals the first, whatever the rounding
      best_ = cost;
      answer_.unresisted[wall] = error;
      for (std::size_t i = 0; i < m; ++i) {
        answer_.locked[wall * m + i] = (sets_[row] >> i & 1) != 0;
        answer_.tensions[wall * m + i] = tensions_[row * m + i];
      }
    }
  }

  double error_of(const double* tensions) const {
    double square = 0;
    for (int k = 0; k < walls_.motors.n; ++k) {
      double sum = -desired_[k];
      for (int i = 0; i < m_; ++i) sum += structure_[k * m_ + i] * tensions[i];
      square += sum * sum;
    }
    return std::sqrt(square);
  }

  const Walls& walls_;
  const LockRule& rule_;
  double rank_tolerance_;
  const LockAnswer& answer_;
  int m_;
  const double* structure_ = nullptr;
  double desired_[kMaxComponents], best_ = 0;
  std::vector<Set> sets_, larger_;
  std::vector<double> upper_, tensions_, separation_;
  std::vector<std::int64_t> iterations_;
};

}  // namespace tensionlab
