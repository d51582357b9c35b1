// The host's ends of links to modules for Python: single ones, those of all modules of a rig, and their reader.
#include <nanobind/stl/vector.h>

#include <limits>
#include <tuple>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "hardware/endpoint.hpp"

namespace tensionlab {
namespace {

nb::list decode(FrameDecoder& self, const nb::bytes& content) {
  nb::list frames;
  self.feed(bytes_of(content), content.size(),
            [&](const firmware::Frame& frame) { frames.append(tuple_of(frame)); });
  return frames;
}

nb::list take_queue(Endpoint& self) {
  nb::list frames;
  for (const firmware::Frame& frame : self.take_queue()) frames.append(tuple_of(frame));
  return frames;
}

bool take(Endpoint& self, const nb::bytes& payload, double now) {
  Telemetry telemetry;
  require(telemetry.read(bytes_of(payload), payload.size()), "no telemetry");
  return self.take(telemetry, now);
}

// The latest telemetry if it has another number than the one seen: number, payload and time of arrival.
nb::object latest(const Endpoint& self, std::uint64_t seen) {
  const Endpoint::Known known = self.known();
  if (known.telemetries == seen) return nb::none();
  return nb::make_tuple(known.telemetries, to_bytes(known.latest.payload, Telemetry::kSize),
                        known.latest.received);
}

// Payload and time of arrival; None of number 0.
nb::object report_of(const Telemetry& telemetry, std::uint64_t number) {
  if (number == 0) return nb::none();
  return nb::make_tuple(to_bytes(telemetry.payload, Telemetry::kSize), telemetry.received);
}

// The telemetry that was checked before, and the latest, unless that is the same; the latest counts as checked
// then.
nb::object unchecked(Endpoint& self) {
  const Endpoint::Known known = self.known();
  if (known.telemetries == known.checks) return nb::none();
  self.set_checked();
  return nb::make_tuple(report_of(known.checked, known.checks), report_of(known.latest, known.telemetries));
}

class EndpointGroup {
 public:
  explicit EndpointGroup(const nb::list& endpoints) : owners_(endpoints) {
    for (nb::handle each : owners_) endpoints_.push_back(&nb::cast<Endpoint&>(each));
  }

  using Clocks = std::vector<double>;
  using Mask = Contiguous<bool, 1>;
  using Numbers = Contiguous<double, 1>;

  // Lengths, speeds, tensions, ages, windings' temperatures and bearable tensions (6, m); states, faults,
  // limiters, brakes and last sequence numbers (5, m). State and limiter of modules that have reported nothing are
  // given.
  nb::tuple observe(const Clocks& clocks, int idle_state, int idle_limit) const {
    const std::size_t m = endpoints_.size();
    require(clocks.size() == m, "one time for each module");
    const auto measured = make_array<double>(6, m);
    const auto codes = make_array<std::int64_t>(5, m);
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    for (std::size_t i = 0; i < m; ++i) {
      const Endpoint::Known known = endpoints_[i]->known();
      const Telemetry& t = known.latest;
      const bool reported = known.telemetries > 0;
      const double age = reported ? clocks[i] - t.received : std::numeric_limits<double>::infinity();
      const double numbers[] = {reported ? t.length : kNan,
                                reported ? t.speed : kNan,
                                reported ? t.tension : kNan,
                                age,
                                reported ? static_cast<double>(t.winding) : kNan,
                                reported ? t.bearable : kNan};
      const int state = known.fields.state == Endpoint::kNoState ? t.state : known.fields.state;
      const int last[] = {reported ? state : idle_state, reported ? known.fields.faults : 0,
                          reported ? t.limit : idle_limit, reported ? t.brake : -1, reported ? t.sequence : -1};
      for (std::size_t row = 0; row < 6; ++row) measured.data()[row * m + i] = numbers[row];
      for (std::size_t row = 0; row < 5; ++row) codes.data()[row * m + i] = last[row];
    }
    return nb::make_tuple(measured, codes);
  }

  // Indices of active modules that may not be well; delays: those of the set-points that they follow.
  nb::list suspects(const Clocks& clocks, const Mask& active, const Numbers& delays, double ttl) {
    const std::size_t m = endpoints_.size();
    require(clocks.size() == m && active.size() == m && delays.size() == m, "one entry for each module");
    nb::list found;
    for (std::size_t i = 0; i < m; ++i) {
      if (active.data()[i] && (!endpoints_[i]->is_well(clocks[i], ttl) || delays.data()[i] > ttl)) found.append(i);
    }
    return found;
  }

  // Sends tensions to the chosen modules. Returns their sequence numbers, -1 where none was sent; indices of those
  // that Python must send itself; and of those that failed the index and the system's error, 0 where only a part
  // was sent.
  nb::tuple send(const Numbers& tensions, const Mask& chosen, const Mask& brakes, std::uint16_t ttl_ms) {
    const std::size_t m = endpoints_.size();
    require(tensions.size() == m && chosen.size() == m && brakes.size() == m, "one entry for each module");
    const auto result = make_array<std::int64_t>(m);
    std::int64_t* const sequences = result.data();
    nb::list unsent, failed;
    for (std::size_t i = 0; i < m; ++i) {
      sequences[i] = Endpoint::kNotSent;
      if (!chosen.data()[i]) continue;
      int error = 0;
      Endpoint::Sent sent = Endpoint::Sent::yes;
      std::tie(sequences[i], sent) =
          endpoints_[i]->send_tension(tensions.data()[i], brakes.data()[i], ttl_ms, error);
      if (sent == Endpoint::Sent::in_part || sent == Endpoint::Sent::broken) {
        failed.append(nb::make_tuple(i, sent == Endpoint::Sent::broken ? error : 0));
      } else if (sent != Endpoint::Sent::yes) {
        unsent.append(i);
      }
    }
    return nb::make_tuple(result, unsent, failed);
  }

 private:
  nb::tuple owners_;  // a copy of the caller's list
  std::vector<Endpoint*> endpoints_;
};

template <class T>
void bind_field(nb::class_<Endpoint>& endpoint, const char* name, T Endpoint::Fields::* field) {
  endpoint.def_prop_rw(
      name, [field](const Endpoint& self) { return self.known().fields.*field; },
      [field](Endpoint& self, T value) { self.set(field, value); });
}

std::vector<Descriptor> wait(LinkReader& self) {
  nb::gil_scoped_release unlocked;
  return self.wait();
}

}  // namespace

void bind_endpoints(nb::module_& module) {
  module.attr("MAX_LENGTH_JUMP_M") = kMaxLengthJump;
  module.attr("MAX_ACCELERATION_M_S2") = kMaxAcceleration;
  module.def("seconds_now", &seconds_now);
  nb::class_<FrameDecoder>(module, "FrameDecoder")
      .def(nb::init<>())
      .def("feed", &decode)
      .def_prop_ro("bad_frames", &FrameDecoder::bad_frames)
      .def_prop_ro("kept", &FrameDecoder::kept);
  nb::class_<Endpoint> endpoint(module, "Endpoint");
  endpoint.def(nb::init<std::uint8_t>())
      .def("feed", [](Endpoint& self, const nb::bytes& content,
                      double now) { return self.feed(bytes_of(content), content.size(), now); })
      .def("take_queue", &take_queue)
      .def("take", &take)
      .def("next_set_point", &Endpoint::next_set_point)
      .def("next_arm", &Endpoint::next_arm)
      .def("unchecked", &unchecked)
      .def("clear_checked", &Endpoint::clear_checked)
      .def("latest", &latest)
      .def_prop_ro("stale", [](const Endpoint& self) { return self.known().stale; })
      .def_prop_ro("repeated", [](const Endpoint& self) { return self.known().repeated; })
      .def_prop_ro("bad_frames", [](const Endpoint& self) { return self.known().bad_frames; })
      .def_prop_ro("kept", [](const Endpoint& self) { return self.known().kept; })
      .def_prop_ro("followed", [](const Endpoint& self) { return self.known().followed; })
      .def("set_file", [](Endpoint& self, Descriptor file) { self.set(&Endpoint::Fields::file, file); });
  bind_field(endpoint, "state", &Endpoint::Fields::state);
  bind_field(endpoint, "faults", &Endpoint::Fields::faults);
  bind_field(endpoint, "session", &Endpoint::Fields::session);
  bind_field(endpoint, "python_decodes", &Endpoint::Fields::python_decodes);
  bind_field(endpoint, "needs_attention", &Endpoint::Fields::needs_attention);
  nb::class_<EndpointGroup>(module, "EndpointGroup")
      .def(nb::init<nb::list>())
      .def("observe", &EndpointGroup::observe)
      .def("suspects", &EndpointGroup::suspects)
      .def("send", &EndpointGroup::send);
  nb::class_<LinkReader>(module, "LinkReader")
      .def(nb::init<>())
      .def(
          "add", [](LinkReader& self, Descriptor file, Endpoint* endpoint) { self.add(file, endpoint); },
          nb::arg("file"), nb::arg("endpoint").none())
      .def("drop", &LinkReader::drop)
      .def("wait", &wait);
}

}  // namespace tensionlab
