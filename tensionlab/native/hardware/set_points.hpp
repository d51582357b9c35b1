// Set-points of modules: the next ones, and how old those are that modules report to follow.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace tensionlab {

struct NextTensions {
  std::ptrdiff_t refused = -1;  // a free module whose tension is outside its limits or NaN; -1: none
  bool slew_limited = false;
};

// Moves the tensions of the free modules from `before` towards those chosen, all by the same share, so that the
// wrench changes in a straight line; the others stay. `commanded` is NaN where a module is not free.
inline NextTensions next_tensions(std::size_t m, const double* before, const double* chosen, const bool* free,
                                  const double* lower, const double* upper, double max_change, double* after,
                                  double* commanded) {
  NextTensions next;
  double largest = 0.0;
  for (std::size_t i = 0; i < m; ++i) {
    if (!free[i]) continue;
    if (!(lower[i] <= chosen[i] && chosen[i] <= upper[i])) {
      next.refused = static_cast<std::ptrdiff_t>(i);
      return next;
    }
    largest = std::max(largest, std::abs(chosen[i] - before[i]));
  }
  constexpr double kRounding = 1e-12;  // of tensions that were chosen to change by just as much
  next.slew_limited = !(largest <= max_change * (1 + kRounding));
  const double share = next.slew_limited ? max_change / largest : 1.0;
  for (std::size_t i = 0; i < m; ++i) {
    const double wanted = free[i] ? chosen[i] : before[i];
    after[i] = next.slew_limited ? before[i] + (wanted - before[i]) * share : wanted;
    commanded[i] = free[i] ? after[i] : std::numeric_limits<double>::quiet_NaN();
  }
  return next;
}

// Ages of set-points, by the times at which they were sent. A sequence number is used for many set-points at high
// rates. Which one it is follows from the number sent since the last report; of the first one that is reported,
// the newest is taken.
class SetPointDelays {
 public:
  static constexpr std::int64_t kSequenceNumbers = 256;

  // kept: the set-points of each module whose times are kept, a multiple of kSequenceNumbers.
  SetPointDelays(std::size_t modules, std::int64_t kept)
      : kept_(kept), modules_(modules), times_(modules * static_cast<std::size_t>(kept)) {}

  std::size_t size() const { return modules_.size(); }

  // Notes the numbers of set-points that were sent now; -1 where none was.
  void send(const std::int64_t* sequences, double now) {
    for (std::size_t i = 0; i < modules_.size(); ++i) {
      Module& module = modules_[i];
      if (sequences[i] < 0) continue;
      if (module.sent < 0) {
        module.own = module.sent = sequences[i] + kSequenceNumbers;
        module.first = now;
      } else {
        module.sent += wrapped(sequences[i] - module.sent);
      }
      time_of(i, module.sent) = now;
    }
  }

  // Finds the ages of the set-points that modules report to follow, NaN where that is none of these; and the same
  // with the time since the first was sent in place of NaN. A number is -1 where none has been reported yet.
  void delays(const std::int64_t* last, double now, double* ages, double* at_least) {
    for (std::size_t i = 0; i < modules_.size(); ++i) {
      Module& module = modules_[i];
      const std::int64_t newest = module.sent - wrapped(module.sent - last[i]);
      const bool known = last[i] >= 0 && module.sent >= 0 && newest >= module.own;
      if (known) {
        const std::int64_t found =
            module.followed < module.own ? newest : std::min(likely(module, last[i]), newest);
        if (found != module.followed) module.sent_then = module.sent;
        module.followed = found;
      }
      ages[i] = known ? now - time_of(i, module.followed) : std::numeric_limits<double>::quiet_NaN();
      at_least[i] = known ? ages[i] : now - module.first;
    }
  }

 private:
  struct Module {
    std::int64_t sent = -1;  // the latest set-point, counted through; -1 before the first
    std::int64_t own = 0;    // the first one
    double first = std::numeric_limits<double>::quiet_NaN();  // when that was sent
    std::int64_t followed = -1;
    std::int64_t sent_then = 0;  // the latest when `followed` changed
  };

  static std::int64_t wrapped(std::int64_t number) {
    return (number % kSequenceNumbers + kSequenceNumbers) % kSequenceNumbers;
  }

  // Modules take set-points as fast as they are sent, give or take half a round of numbers.
  static std::int64_t likely(const Module& module, std::int64_t last) {
    const std::int64_t step = wrapped(last - module.followed);
    const auto behind = static_cast<double>(module.sent - module.sent_then - step);
    const auto rounds = static_cast<std::int64_t>(std::nearbyint(behind / kSequenceNumbers));
    return module.followed + std::max<std::int64_t>(step + kSequenceNumbers * rounds, 0);
  }

  double& time_of(std::size_t module, std::int64_t set_point) {
    return times_[module * static_cast<std::size_t>(kept_) + static_cast<std::size_t>(set_point % kept_)];
  }

  std::int64_t kept_;
  std::vector<Module> modules_;
  std::vector<double> times_;
};

}  // namespace tensionlab
