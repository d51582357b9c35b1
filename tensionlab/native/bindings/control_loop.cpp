// What a run needs in every cycle, for Python: pose, length check, set-points, brakes to lock, modules' springs,
// watchdog.
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "hardware/length_check.hpp"
#include "hardware/lock_sets.hpp"
#include "hardware/pose_tracker.hpp"
#include "hardware/set_points.hpp"
#include "hardware/watchdog.hpp"
#include "solvers/module_springs.hpp"

namespace tensionlab {
namespace {

// One entry for each cable or module.
using Flags = Contiguous<bool, 1>;
using Numbers = Contiguous<double, 1>;
using Integers = Contiguous<std::int64_t, 1>;
using Table = Contiguous<double, 2>;

template <class... Arrays>
void require_entries(std::size_t count, const Arrays&... arrays) {
  require(((arrays.size() == count) && ...), "one entry for each cable or module");
}

void make_tracker(PoseTracker* self, const Table& anchors, const Table& attachments, const Numbers& position,
                  const Numbers& radii, const Table& axes) {
  const std::size_t m = anchors.shape(0), d = position.size();
  require(m > 0 && (d == 2 || d == 3) && has_shape(anchors, m, d) &&
              (has_shape(attachments, m, d) || has_shape(attachments, 0, d)),
          "anchors must be (m, d), attachments too or (0, d), and position (d), with d = 2 or 3");
  require((radii.size() == m && has_shape(axes, m, d)) || (radii.size() == 0 && has_shape(axes, 0, d)),
          "radii must be (m) and axes (m, d), or (0) and (0, d)");
  new (self) PoseTracker(to_vector(anchors), to_vector(attachments), to_vector(position), to_vector(radii),
                         to_vector(axes));
}

// Position, rotation and structure matrix; the sum of the squared length residuals, the index of the cable with
// the largest one, and that one.
nb::tuple follow(PoseTracker& tracker, const Numbers& lengths, const Flags& known, int steps, double tolerance) {
  const auto n = static_cast<std::size_t>(tracker.dof()), m = static_cast<std::size_t>(tracker.cables());
  const auto d = static_cast<std::size_t>(tracker.dimension());
  require_entries(m, lengths, known);
  tracker.follow(lengths.data(), known.data(), steps, tolerance);
  const auto structure = make_array<double>(n, m);
  std::copy(tracker.structure().begin(), tracker.structure().end(), structure.data());
  auto rotation = make_array<double>(d, d);
  for (std::size_t i = 0; i < d; ++i) {
    for (std::size_t j = 0; j < d; ++j) rotation(i, j) = tracker.rotation()[i][j];
  }
  double squares = 0.0;
  std::size_t worst = 0;
  const std::vector<double>& residuals = tracker.residuals();
  for (std::size_t cable = 0; cable < m; ++cable) {
    squares += residuals[cable] * residuals[cable];
    if (std::abs(residuals[cable]) > std::abs(residuals[worst])) worst = cable;
  }
  return nb::make_tuple(to_array(tracker.position()), rotation, structure, squares, worst,
                        std::abs(residuals[worst]));
}

Out<double, 1> velocity(const PoseTracker& tracker, const Numbers& speeds, const Flags& known) {
  require_entries(static_cast<std::size_t>(tracker.cables()), speeds, known);
  const Vector twist = tracker.velocity(speeds.data(), known.data());
  return to_array(twist.data(), static_cast<std::size_t>(tracker.dof()));
}

// The largest doubt and creep of `LengthCheck`.
nb::tuple check_lengths(LengthCheck& check, const PoseTracker& tracker, const Numbers& lengths,
                        const Numbers& speeds, const Numbers& tensions, const Flags& known, double seconds) {
  require_entries(check.size(), lengths, speeds, tensions, known, tracker.residuals());
  const auto result = check.update(tracker, lengths.data(), speeds.data(), tensions.data(), known.data(), seconds);
  return nb::make_tuple(result.doubt, result.creep);
}

double protection_of(const LengthCheck& check, const PoseTracker& tracker, const Numbers& tensions) {
  require_entries(check.size(), tensions, tracker.residuals());
  return check.protection(tracker, tensions.data());
}

// Doubts, residuals, biases and creeps of all cables.
nb::tuple doubts_of(const LengthCheck& check) {
  std::vector<double> residuals(check.size()), biases(check.size());
  for (std::size_t i = 0; i < check.size(); ++i) {
    residuals[i] = check.residual(i);
    biases[i] = check.bias(i);
  }
  return nb::make_tuple(to_array(check.doubts()), to_array(residuals), to_array(biases), to_array(check.creeps()));
}

void send(SetPointDelays& delays, const Integers& sequences, double now) {
  require_entries(delays.size(), sequences);
  delays.send(sequences.data(), now);
}

nb::tuple delays_of(SetPointDelays& delays, const Integers& last, double now) {
  require_entries(delays.size(), last);
  const auto ages = make_array<double>(last.size()), at_least = make_array<double>(last.size());
  delays.delays(last.data(), now, ages.data(), at_least.data());
  return nb::make_tuple(ages, at_least);
}

// Lengths now, by their speeds and ages; an age counts up to max_age.
Out<double, 1> synchronise(const Numbers& lengths, const Numbers& speeds, const Numbers& ages, double max_age) {
  const std::size_t m = lengths.size();
  require_entries(m, speeds, ages);
  const auto now = make_array<double>(m);
  for (std::size_t i = 0; i < m; ++i) {
    now.data()[i] = lengths.data()[i] + speeds.data()[i] * std::min(ages.data()[i], max_age);
  }
  return now;
}

// Whether any number is at its threshold or above; NaN is not.
bool any_exceeds(const Numbers& numbers, const Numbers& thresholds) {
  require_entries(numbers.size(), thresholds);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers.data()[i] >= thresholds.data()[i]) return true;
  }
  return false;
}

// The next tensions, those of them that are commanded, whether they are slew-rate limited, and the index of one
// that is refused, or -1.
nb::tuple next_of(const Numbers& before, const Numbers& chosen, const Flags& free, const Numbers& lower,
                  const Numbers& upper, double max_change) {
  const std::size_t m = before.size();
  require_entries(m, chosen, free, lower, upper);
  const auto after = make_array<double>(m), commanded = make_array<double>(m);
  const NextTensions next = next_tensions(m, before.data(), chosen.data(), free.data(), lower.data(), upper.data(),
                                          max_change, after.data(), commanded.data());
  return nb::make_tuple(after, commanded, next.slew_limited, next.refused);
}

nb::tuple choose_locks(const Contiguous<double, 3>& structure, const Table& normal, const Numbers& force,
                       const Flags& pushing, const Contiguous<bool, 2>& held, const Numbers& stiffness_ratio,
                       const Table& limits, const Flags& brake, double margin, int most, double price,
                       double hysteresis, double negligible, double rank_tolerance) {
  const std::size_t size = structure.shape(0), n = structure.shape(1), m = structure.shape(2);
  require_size(n, m);
  require(has_shape(normal, size, n) && has_shape(force, size) && has_shape(pushing, size) &&
              has_shape(stiffness_ratio, size) && has_shape(held, size, m) && has_shape(limits, 3, m) &&
              has_shape(brake, m),
          "normals, forces, flags, limits and brakes do not fit the structure matrices");
  const double ones[kMaxComponents] = {1, 1, 1, 1, 1, 1};
  const Rows lower{limits.data(), 0}, upper{limits.data() + m, 0};
  const Batch motors{
      size, static_cast<int>(n), static_cast<int>(m), rows_of(structure), rows_of(normal), lower, upper, lower,
      ones};
  const Walls walls{motors,      force.data(), stiffness_ratio.data(), limits.data() + 2 * m, pushing.data(),
                    held.data(), brake.data()};
  const LockRule rule{margin, most, price, hysteresis, negligible};
  const auto locked = make_array<bool>(size, m), available = make_array<bool>(size, m);
  const auto tensions = make_array<double>(size, m);
  const auto unresisted = make_array<double>(size);
  const LockAnswer answer{locked.data(), available.data(), tensions.data(), unresisted.data()};
  share_out(size, [&](std::size_t begin, std::size_t end) {
    LockSets sets(walls, rule, rank_tolerance, answer);
    for (std::size_t wall = begin; wall < end; ++wall) sets.choose(wall);
  });
  return nb::make_tuple(locked, tensions, unresisted, available);
}

// Structure (d, m), force (d), desired stiffness and damping (2, d, d), ranges (6, m), and the weights of what is
// free and of a tie: see `ScaledField`.
using FieldArrays = std::tuple<Table, Numbers, Contiguous<double, 3>, Table, double, double>;

FieldInput field_input(const FieldArrays& arrays) {
  const auto& [structure, force, desired, ranges, free_weight, tie_break] = arrays;
  const std::size_t d = structure.shape(0), m = structure.shape(1);
  require_size(d, m);
  require(has_shape(force, d) && has_shape(desired, 2, d, d) && has_shape(ranges, 6, m),
          "force, desired matrices and ranges do not fit the structure matrix");
  return {static_cast<int>(d), static_cast<int>(m), structure.data(), force.data(),
          desired.data(),      ranges.data(),       free_weight,      tie_break};
}

double gap_of(const FieldArrays& arrays, const Numbers& stiffness, const Numbers& damping, const Numbers& tensions,
              const Numbers& multipliers) {
  const ScaledField field(field_input(arrays));
  const FieldProblem springs = field.springs(), dampers = field.dampers();
  require_entries(static_cast<std::size_t>(springs.m), stiffness, damping, tensions);
  require_entries(static_cast<std::size_t>(springs.d), multipliers);
  double k[kMaxCables], c[kMaxCables], t[kMaxCables];
  for (int i = 0; i < springs.m; ++i) {
    k[i] = stiffness.data()[i] / field.stiffness;
    c[i] = damping.data()[i] / field.damping;
    t[i] = tensions.data()[i] / field.tension;
  }
  return field_gap(springs, k, t, multipliers.data()) + field_gap(dampers, c, nullptr, nullptr);
}

// Tensions, stiffness and damping of each cable, the force, its multipliers, and the gap.
nb::tuple allocate_field(const FieldArrays& arrays) {
  const FieldInput input = field_input(arrays);
  const auto d = static_cast<std::size_t>(input.d), m = static_cast<std::size_t>(input.m);
  const FieldAnswer found(input);
  return nb::make_tuple(to_array(found.tensions, m), to_array(found.stiffness, m), to_array(found.damping, m),
                        to_array(found.force, d), to_array(found.multipliers, d), found.gap);
}

nb::tuple predict_of(const Table& matrix, const Numbers& axis, double desired, double host) {
  const std::size_t d = axis.size();
  require(d >= 1 && d <= kMaxComponents && has_shape(matrix, d, d), "the axis does not fit the matrix");
  const FeltStiffness felt = predict_stiffness(static_cast<int>(d), matrix.data(), axis.data(), desired, host);
  return nb::make_tuple(felt.along, felt.across, felt.added, felt.share, felt.error);
}

double stable_share_of(const Table& matrix, const Numbers& axis, double mass, double lag) {
  const std::size_t d = axis.size();
  require(d >= 1 && d <= kMaxComponents && has_shape(matrix, d, d), "the axis does not fit the matrix");
  return stable_share(static_cast<int>(d), matrix.data(), axis.data(), mass, lag);
}

// Of an `AxisPart` without its axis, of `SpringLimits` and of `SpringRule`.
using PartNumbers = std::tuple<double, double, double, double, double, double, double>;
using LimitNumbers = std::tuple<double, double, double, double, double, double>;
using RuleNumbers = std::array<double, 13>;

// Springs as (cable, rest, stiffness, damping, feed-forward, amplitude, frequency), their force on the hand, the
// stiffness along and across that the hand feels, and the share of a field; None if the host alone is better.
nb::object module_springs(const Numbers& axis, const PartNumbers& numbers, const Numbers& velocity,
                          const Numbers& lengths, const In<2>& directions, const Flags& available,
                          const Flags& free, const Numbers& gains, const LimitNumbers& limits,
                          const RuleNumbers& rule, double host_stiffness, double previous_share, double step) {
  const std::size_t m = directions.shape(0), d = directions.shape(1);
  require_size(d, m);
  require_entries(m, lengths, available, free);
  require_entries(d, axis, velocity);
  if (std::get<4>(numbers) != 0) require_entries(m, gains);
  double unit[kMaxCables * kMaxComponents];
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t a = 0; a < d; ++a) unit[i * d + a] = directions(i, a);
  }
  const auto make = [](auto... each) { return SpringLimits{each...}; };
  const auto part = [&](auto... each) { return AxisPart{axis.data(), each...}; };
  const SpringRule springs_rule{rule[0], rule[1], rule[2], rule[3],  rule[4],  rule[5], rule[6],
                                rule[7], rule[8], rule[9], rule[10], rule[11], rule[12]};
  ModuleSprings found({static_cast<int>(d), static_cast<int>(m), unit, lengths.data(), available.data(),
                       free.data(), gains.data(), velocity.data()},
                      std::apply(part, numbers), std::apply(make, limits), springs_rule, host_stiffness);
  if (!found.choose(previous_share, step)) return nb::none();
  nb::list springs;
  for (int s = 0; s < found.count; ++s) {
    const ModuleSprings::Spring& each = found.springs[s];
    springs.append(nb::make_tuple(each.cable, each.rest, each.stiffness, each.damping, each.feed_forward,
                                  each.amplitude, each.frequency));
  }
  return nb::make_tuple(springs, to_array(found.force, d), found.felt.along, found.felt.across, found.share);
}

}  // namespace

void bind_control_loop(nb::module_& module) {
  nb::class_<PoseTracker>(module, "PoseTracker")
      .def("__init__", &make_tracker)
      .def("follow", &follow)
      .def("velocity", &velocity);
  nb::class_<LengthCheck>(module, "LengthCheck")
      .def(nb::init<std::size_t>())
      .def("update", &check_lengths)
      .def("protection", &protection_of)
      .def("doubts", &doubts_of);
  nb::class_<SetPointDelays>(module, "SetPointDelays")
      .def("__init__",
           [](SetPointDelays* self, std::size_t modules, std::int64_t kept) {
             require(kept > 0 && kept % SetPointDelays::kSequenceNumbers == 0, "whole rounds of numbers are kept");
             new (self) SetPointDelays(modules, kept);
           })
      .def("send", &send)
      .def("delays", &delays_of);
  nb::class_<Watchdog>(module, "Watchdog")
      .def(nb::init<std::string>())
      .def("kick", &Watchdog::kick)
      .def("close", &Watchdog::close);
  module.def("synchronise", &synchronise);
  module.def("any_exceeds", &any_exceeds);
  module.def("next_tensions", &next_of);
  module.def("choose_locks", &choose_locks);
  module.def("allocate_field", &allocate_field);
  module.def("field_gap", &gap_of);
  module.def("predict_stiffness", &predict_of);
  module.def("stable_share", &stable_share_of);
  module.def("module_springs", &module_springs);
}

}  // namespace tensionlab
