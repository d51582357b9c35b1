// Springs and dampers of modules that render a part of an effect along an axis: on the cable that lies best along
// it, or on all cables that pull along it, where a hand feels that nearer to what is desired.
// tensionlab/haptics/rendering/assignment.py has the rule, and field.py what a hand feels.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "solvers/felt_stiffness.hpp"
#include "solvers/impedance_field.hpp"

namespace tensionlab {

// The part: a push of feed_forward + max(stiffness compression + damping its rate, 0) + amplitude sin(2 pi
// frequency t) N along the axis (d), up to a further compression of `reach` m.
struct AxisPart {
  const double* axis;
  double compression, stiffness, damping, feed_forward, amplitude, frequency, reach;
};

struct SpringLimits {
  double lower, upper, stiffness, damping, length, slew;
};

// The numbers of `SpringRule` in assignment.py.
struct SpringRule {
  double lead, yielding, yielding_stiffness, min_cosine, min_field_cosine, noticeable, max_gap, free_weight,
      tie_break, late_damping, hand_mass, damping_share, settling;
};

// directions (m x d): unit vectors from the hand; lengths (m) of the cables; available, free (m): modules that may
// render an impedance, and those without one yet. gains (m): of a vibration, from the motor to the cable's end;
// not used for a part without. velocity (d) of the hand.
struct SpringCables {
  int d, m;
  const double *directions, *lengths;
  const bool *available, *free;
  const double *gains, *velocity;
};

class ModuleSprings {
 public:
  struct Spring {
    int cable;
    double rest, stiffness, damping, feed_forward = 0, amplitude = 0, frequency = 0;
  };
  int count = 0;
  Spring springs[kMaxCables];
  FeltStiffness felt;
  double share = 0;              // of the field that is nearest to the part; 0 if it is no field
  double force[kMaxComponents];  // on the hand, without vibration, with the host's corrections

  ModuleSprings(const SpringCables& cables, const AxisPart& part, const SpringLimits& limits,
                const SpringRule& rule, double host_stiffness)
      : c_(cables), part_(part), limits_(limits), rule_(rule), host_(host_stiffness) {
    lag_ = host_ > 0 ? rule.late_damping / host_ : 0.0;
    rate_ = -dot(part.axis, c_.velocity);
    for (int a = 0; a < c_.d; ++a) way_[a] = rule.lead * lag_ * (c_.velocity[a] + rate_ * part.axis[a]);
    for (int i = 0; i < c_.m; ++i) {
      cosine_[i] = dot(direction(i), part.axis);
      length_[i] = c_.lengths[i] - dot(direction(i), way_);
    }
  }

  // False if the host alone is better. previous_share: of a field `step` s ago, or 0. A change from or to a field
  // has to be noticeably better.
  bool choose(double previous_share, double step) {
    const int best = best_cable();
    if (best >= 0) {
      springs[count++] = along_cable(best);
      felt = predict();
    }
    // Not for a spring that ends before a late host can end it.
    const bool spring = part_.stiffness > 0 && part_.amplitude == 0 && part_.feed_forward == 0;
    if (spring && std::isinf(part_.reach)) {
      double error = best >= 0 ? felt.error : 1.0 - std::fmin(host_ / part_.stiffness, 1.0);
      error *= previous_share > 0 ? 1.0 + rule_.noticeable : 1.0 - rule_.noticeable;
      if (error > rule_.noticeable) {
        ModuleSprings field(c_, part_, limits_, rule_, host_);
        const double alone = std::fmin(part_.damping, most_damping()) - (lag_ > 0 ? rule_.late_damping : 0.0);
        const double least = best >= 0 ? std::fmin(damping(), alone) : alone;
        if (field.allocate(least, previous_share, step) && field.felt.error < error) {
          *this = field;
        }
      }
    }
    if (count > 0) expect_force();
    return count > 0;
  }

 private:
  const double* direction(int cable) const { return c_.directions + cable * c_.d; }

  double dot(const double* a, const double* b) const {
    double sum = 0;
    for (int k = 0; k < c_.d; ++k) sum += a[k] * b[k];
    return sum;
  }

  int best_cable() const {
    int best = -1;
    for (int i = 0; i < c_.m; ++i) {
      if (c_.free[i] && cosine_[i] >= rule_.min_cosine && (best < 0 || cosine_[i] > cosine_[best])) best = i;
    }
    return best;
  }

  double rest(int cable, double compression) const {
    return std::fmin(std::fmax(length_[cable] - cosine_[cable] * compression, 0.0), limits_.length);
  }

  // If the hand goes in by dx, a cable at cosine c to the axis pays out c dx, and the share c of its tension is
  // along the axis: stiffness and damping grow with 1/c², forces with 1/c. The module damps whenever its cable
  // pays out, so it gets the damping only in contact.
  Spring along_cable(int cable) const {
    const double c = cosine_[cable];
    double amplitude = 0, lowest = 0;
    if (part_.amplitude != 0) {
      const double gain = c_.gains[cable], swing = std::fmax(gain, 1.0);  // taut at both ends
      amplitude = std::fmin(part_.amplitude / (c * gain), (limits_.upper - limits_.lower) / (2.0 * swing));
      if (part_.frequency != 0) amplitude = std::fmin(amplitude, limits_.slew / (kFullTurn * part_.frequency));
      lowest = limits_.lower + amplitude * swing;
    }
    return {cable,
            rest(cable, part_.compression),
            std::fmin(part_.stiffness / (c * c), limits_.stiffness),
            part_.compression >= 0 ? std::fmin(part_.damping / (c * c), limits_.damping) : 0.0,
            std::fmin(std::fmax(part_.feed_forward / c, lowest), limits_.upper),
            amplitude,
            part_.frequency};
  }

  // Springs of free cables that together are nearest to the part, softened as a whole so that they are no less
  // damped than `least_damping`: slowly, because a stiffness that follows the hand late drives it. False if none
  // are proved. They end at the part's surface, so that a hand that withdraws before the host knows is not held.
  // Tensions are inside the limits from there to the hand's depth.
  bool allocate(double least_damping, double previous_share, double step) {
    double structure[kMaxComponents * kMaxCables], ranges[6 * kMaxCables];
    double desired[2 * kMaxComponents * kMaxComponents], push[kMaxComponents];
    double* const fall = ranges + 4 * c_.m;
    for (int i = 0; i < c_.m; ++i) {
      const bool usable = c_.free[i] && cosine_[i] > rule_.min_field_cosine;
      for (int a = 0; a < c_.d; ++a) structure[a * c_.m + i] = direction(i)[a];
      ranges[i] = c_.available[i] ? limits_.lower : 0.0;
      ranges[c_.m + i] = limits_.upper;
      ranges[2 * c_.m + i] = usable ? limits_.stiffness : 0.0;
      ranges[3 * c_.m + i] = usable ? limits_.damping : 0.0;
      fall[i] = usable ? cosine_[i] * std::fmax(part_.compression, 0.0) : 0.0;
      fall[c_.m + i] = 0.0;  // beyond, a module holds its largest tension
    }
    // On the way out the springs still need their tensions.
    const double size =
        std::fmax(part_.stiffness * part_.compression + part_.damping * std::fmax(rate_, 0.0), 0.0);
    const double sizes[] = {part_.stiffness, part_.damping};
    for (int a = 0; a < c_.d; ++a) {
      push[a] = size * part_.axis[a];
      for (int b = 0; b < c_.d; ++b) {
        for (int kind = 0; kind < 2; ++kind) {
          desired[(kind * c_.d + a) * c_.d + b] = sizes[kind] * part_.axis[a] * part_.axis[b];
        }
      }
    }
    const FieldAnswer found({c_.d, c_.m, structure, push, desired, ranges, rule_.free_weight, rule_.tie_break});
    if (!(found.gap <= rule_.max_gap)) return false;
    for (int i = 0; i < c_.m; ++i) {
      if (!(found.stiffness[i] > 1e-3 * limits_.stiffness)) continue;
      springs[count++] = {i, rest(i, part_.compression), found.stiffness[i],
                          part_.compression >= 0 ? found.damping[i] : 0.0};
    }
    double matrix[kMaxComponents * kMaxComponents];
    fill(matrix);
    soften(host_ > 0 ? stable_share(c_.d, matrix, part_.axis, rule_.hand_mass, lag_) : 0.0);
    const ModuleSprings stiff = *this;
    const auto soften_to = [&](double softened) {
      *this = stiff;
      share = softened;
      soften(share);
      felt = predict();
    };
    double least = 0, most = 1;
    soften_to(1.0);
    if (damping() >= least_damping) least = 1;
    for (int halving = 0; least < 1 && halving < 8; ++halving) {
      soften_to((least + most) / 2);
      (damping() < least_damping ? most : least) = share;
    }
    if (previous_share > 0)
      least = previous_share + (least - previous_share) * -std::expm1(-step / rule_.settling);
    soften_to(least);
    return count > 0;
  }

  void soften(double by) {
    for (int s = 0; s < count; ++s) springs[s].stiffness *= by;
  }

  // Stiffness matrix (d x d).
  void fill(double* matrix) const {
    std::fill_n(matrix, c_.d * c_.d, 0.0);
    for (int s = 0; s < count; ++s) {
      const double* u = direction(springs[s].cable);
      for (int a = 0; a < c_.d; ++a) {
        for (int b = 0; b < c_.d; ++b) matrix[a * c_.d + b] += springs[s].stiffness * u[a] * u[b];
      }
    }
  }

  FeltStiffness predict() const {
    double matrix[kMaxComponents * kMaxComponents];
    fill(matrix);
    return predict_stiffness(c_.d, matrix, part_.axis, part_.stiffness, host_ / (1.0 - rule_.lead));
  }

  // Largest damping of a late damper.
  double most_damping() const {
    return lag_ > 0 ? rule_.damping_share * rule_.hand_mass / lag_ : std::numeric_limits<double>::infinity();
  }

  // Damping that the host renders against the axis: more of it where the hand yields along the surface.
  double host_damping() const {
    const double yielding = felt.along != 0 ? 1.0 + rule_.yielding * felt.across / felt.along : 1.0;
    return std::fmin(part_.damping * yielding, most_damping());
  }

  // Damping that a hand feels: a hand that goes in is pulled across, yields, and shortens the cables; their rest
  // lengths follow late.
  double damping() const { return host_damping() - lag_ * felt.coupling * felt.across / rule_.yielding_stiffness; }

  // What the host corrects is old when it acts, so it is for a hand that has moved on: along the surface by `way`,
  // and against the axis. The host damps the way out, where modules do not.
  void expect_force() {
    const bool touching = part_.compression > 0;
    const double then = touching ? std::fmax(part_.compression + rule_.lead * lag_ * rate_, 0.0) : 0.0;
    double corrected[kMaxComponents] = {}, dampers[kMaxComponents] = {};
    std::fill_n(force, c_.d, 0.0);
    for (int s = 0; s < count; ++s) {
      const Spring& spring = springs[s];
      const double* u = direction(spring.cable);
      const double c = cosine_[spring.cable];
      const double pull = part_.feed_forward / c;  // without the tension that only keeps a vibrating cable taut
      const double now = spring.stiffness * std::fmax(c * part_.compression + dot(u, way_), 0.0) + pull;
      const double damper = spring.damping * std::fmax(rate_, 0.0) * c;
      for (int a = 0; a < c_.d; ++a) {
        force[a] += now * u[a];
        dampers[a] += damper * u[a];
        corrected[a] += (spring.stiffness * then * c + pull + damper) * u[a];
      }
    }
    double added = felt.added * then;
    if (touching) {
      const double damped = host_damping() * rate_;
      added += rate_ < 0 ? damped : std::fmax(damped, dot(dampers, part_.axis));
    }
    added = std::fmax(added, -dot(force, part_.axis));
    double across[kMaxComponents];
    for (int a = 0; a < c_.d; ++a) across[a] = dampers[a] - felt.share * corrected[a];
    added -= dot(across, part_.axis);
    for (int a = 0; a < c_.d; ++a) force[a] += across[a] + added * part_.axis[a];
  }

  SpringCables c_;
  AxisPart part_;
  SpringLimits limits_;
  SpringRule rule_;
  double host_, lag_, rate_, way_[kMaxComponents], cosine_[kMaxCables], length_[kMaxCables];
};

}  // namespace tensionlab
