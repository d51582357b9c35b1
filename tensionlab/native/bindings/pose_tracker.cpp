// What a run knows of its modules from cycle to cycle, for Python: the pose, how old set-points are, the next
// ones.
#include "hardware/pose_tracker.hpp"

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "hardware/length_check.hpp"
#include "hardware/next_tensions.hpp"
#include "hardware/set_point_delays.hpp"

namespace tensionlab {
namespace {

using Known = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Lengths = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class Array>
std::vector<double> copied(const Array& array) {
  return {array.data(), array.data() + array.size()};
}

void require_size(const PoseTracker& tracker, std::size_t lengths, std::size_t known) {
  const auto m = static_cast<std::size_t>(tracker.cables());
  require(lengths == m && known == m, "one entry for each cable");
}

Out<double, 1> one_row(const double* from, std::size_t size) {
  const auto row = make_array<double>(size);
  std::copy(from, from + size, row.data());
  return row;
}

// Position, rotation, structure matrix; then the squares of what the lengths are short of, summed, the cable that
// is off most, and by how much.
nb::tuple follow(PoseTracker& tracker, const Lengths& lengths, const Known& known, int steps, double found) {
  require_size(tracker, lengths.size(), known.size());
  tracker.follow(lengths.data(), known.data(), steps, found);
  const auto n = static_cast<std::size_t>(tracker.dof()), m = static_cast<std::size_t>(tracker.cables());
  const auto d = static_cast<std::size_t>(tracker.dimension());
  const auto structure = make_array<double>(n, m);
  std::copy(tracker.structure().begin(), tracker.structure().end(), structure.data());
  auto rotation = make_array<double>(d, d);
  for (std::size_t i = 0; i < d; ++i) {
    for (std::size_t j = 0; j < d; ++j) rotation(i, j) = tracker.rotation()[i][j];
  }
  double squares = 0.0;
  std::size_t worst = 0;
  const std::vector<double>& missing = tracker.missing();
  for (std::size_t cable = 0; cable < m; ++cable) {
    squares += missing[cable] * missing[cable];
    if (std::abs(missing[cable]) > std::abs(missing[worst])) worst = cable;
  }
  return nb::make_tuple(one_row(tracker.position().data(), d), rotation, structure, squares, worst,
                        std::abs(missing[worst]));
}

Out<double, 1> velocity(const PoseTracker& tracker, const Lengths& speeds, const Known& known) {
  require_size(tracker, speeds.size(), known.size());
  const Vector found = tracker.velocity(speeds.data(), known.data());
  return one_row(found.data(), static_cast<std::size_t>(tracker.dof()));
}

// The largest doubt, creep and force in doubt of `LengthCheck`.
nb::tuple check_lengths(LengthCheck& check, const PoseTracker& tracker, const Lengths& lengths,
                        const Lengths& speeds, const Lengths& tensions, const Known& known, double seconds) {
  require_size(tracker, lengths.size(), known.size());
  require_size(tracker, speeds.size(), check.size());
  require(tensions.size() == check.size(), "one tension for each cable");
  const auto result = check.update(tracker, lengths.data(), speeds.data(), tensions.data(), known.data(), seconds);
  return nb::make_tuple(result.doubt, result.creep);
}

double protection_of(const LengthCheck& check, const PoseTracker& tracker, const Lengths& tensions) {
  require_size(tracker, tensions.size(), check.size());
  return check.protection(tracker, tensions.data());
}

// Doubts, residuals, biases and creeps of all cables.
nb::tuple doubts_of(const LengthCheck& check) {
  const std::size_t m = check.size();
  std::vector<double> residuals(m), biases(m);
  for (std::size_t i = 0; i < m; ++i) {
    residuals[i] = check.residual(i);
    biases[i] = check.bias(i);
  }
  return nb::make_tuple(one_row(check.doubts().data(), m), one_row(residuals.data(), m), one_row(biases.data(), m),
                        one_row(check.creeps().data(), m));
}

using Numbers = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void send(SetPointDelays& delays, const Numbers& sequences, double now) {
  require(sequences.size() == delays.size(), "one entry for each module");
  delays.send(sequences.data(), now);
}

nb::tuple delays_of(SetPointDelays& delays, const Numbers& last, double now) {
  require(last.size() == delays.size(), "one entry for each module");
  const auto ages = make_array<double>(last.size()), at_least = make_array<double>(last.size());
  delays.delays(last.data(), now, ages.data(), at_least.data());
  return nb::make_tuple(ages, at_least);
}

// Lengths now, by their speeds and ages, of which no more than `most` counts.
Out<double, 1> at_one_time(const Lengths& lengths, const Lengths& speeds, const Lengths& ages, double most) {
  const std::size_t m = lengths.size();
  require(speeds.size() == m && ages.size() == m, "one entry for each cable");
  auto now = make_array<double>(m);
  for (std::size_t i = 0; i < m; ++i) {
    now(i) = lengths.data()[i] + speeds.data()[i] * std::min(ages.data()[i], most);
  }
  return now;
}

// Whether any number reaches its threshold; NaN does not.
bool any_reaches(const Lengths& numbers, const Lengths& thresholds) {
  require(numbers.size() == thresholds.size(), "one threshold for each number");
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers.data()[i] >= thresholds.data()[i]) return true;
  }
  return false;
}

// The next tensions, those of them that are commanded, whether they are slew-rate limited, and the index of one
// that is refused, or -1.
nb::tuple next_of(const Lengths& before, const Lengths& chosen, const Known& free, const Lengths& lower,
                  const Lengths& upper, double max_change) {
  const std::size_t m = before.size();
  require(chosen.size() == m && free.size() == m && lower.size() == m && upper.size() == m,
          "one entry for each module");
  const auto after = make_array<double>(m), commanded = make_array<double>(m);
  const NextTensions next = next_tensions(m, before.data(), chosen.data(), free.data(), lower.data(), upper.data(),
                                          max_change, after.data(), commanded.data());
  return nb::make_tuple(after, commanded, next.slew_limited, next.refused);
}

}  // namespace

void bind_pose_tracker(nb::module_& module) {
  nb::class_<PoseTracker>(module, "PoseTracker")
      .def("__init__",
           [](PoseTracker* self, const Table& anchors, const Table& attachments, const Lengths& position,
              const Lengths& radii, const Table& axes) {
             const std::size_t m = anchors.shape(0), d = position.size();
             require(m > 0 && (d == 2 || d == 3) && has_shape(anchors, m, d) &&
                         (has_shape(attachments, m, d) || has_shape(attachments, 0, d)),
                     "anchors must be (m, d), attachments too or (0, d), and position (d), with d = 2 or 3");
             require((radii.size() == m && has_shape(axes, m, d)) || (radii.size() == 0 && has_shape(axes, 0, d)),
                     "radii must be (m) and axes (m, d), or (0) and (0, d)");
             new (self)
                 PoseTracker(copied(anchors), copied(attachments), copied(position), copied(radii), copied(axes));
           })
      .def("follow", &follow)
      .def("velocity", &velocity);
  nb::class_<LengthCheck>(module, "LengthCheck")
      .def(nb::init<std::size_t>())
      .def("update", &check_lengths)
      .def("protection", &protection_of)
      .def("doubts", &doubts_of);
  module.def("at_one_time", &at_one_time);
  module.def("any_reaches", &any_reaches);
  module.def("next_tensions", &next_of);
  nb::class_<SetPointDelays>(module, "SetPointDelays")
      .def("__init__",
           [](SetPointDelays* self, std::size_t modules, std::int64_t kept) {
             require(kept > 0 && kept % SetPointDelays::kSequenceNumbers == 0, "whole rounds of numbers are kept");
             new (self) SetPointDelays(modules, kept);
           })
      .def("send", &send)
      .def("delays", &delays_of);
}

}  // namespace tensionlab
