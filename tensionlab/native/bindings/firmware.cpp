// The module's firmware and its simulated hardware for Python, and the firmware's tables, which the host uses,
// too.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <string>
#include <tuple>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "firmware/plant/simulated.hpp"

namespace tensionlab {
namespace {

using firmware::Frame;
using plant::PlantParameters;
using plant::Sample;
using plant::SimulatedModule;

PlantParameters plant_from(const nb::dict& changes) {
  PlantParameters parameters = plant::standard_plant();
  for (const auto& [key, value] : changes) {
    const std::string name = nb::cast<std::string>(key);
    bool known = false;
    for (const plant::PlantInfo& info : plant::kPlantTable) {
      if (name != info.name) continue;
      parameters.*info.member = nb::cast<double>(value);
      known = true;
    }
    if (!known) throw nb::key_error(name.c_str());
  }
  return parameters;
}

auto fields(const Sample& s) {
  return std::make_tuple(s.seconds, s.distance, s.length, s.tension, s.commanded, s.current, s.brake_force,
                         s.winding, s.estimated_winding, s.state, s.limit, s.driver_on, s.pawl_down);
}

constexpr std::size_t kColumns = std::tuple_size_v<decltype(fields(Sample{}))>;

void write(const Sample& sample, double* row) {
  std::apply([&](auto... field) { ((*row++ = static_cast<double>(field)), ...); }, fields(sample));
}

nb::bytes transmit(SimulatedModule& self) {
  std::uint8_t bytes[1024];
  return to_bytes(bytes, self.transmit(bytes, sizeof bytes));
}

// Holds the interpreter's lock, because other threads may read the module; now and then it lets them.
template <class See>
void advance_and_see(SimulatedModule& self, std::uint32_t steps, double distance, const See& see) {
  constexpr std::uint32_t kStepsAtOnce = 4000;  // some ms
  std::uint32_t done = 0;
  self.advance(steps, distance, [&](const Sample& sample) {
    see(sample);
    if (++done % kStepsAtOnce != 0) return;
    {
      const nb::gil_scoped_release unlocked;
    }
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
  });
}

Out<double, 2> trace(SimulatedModule& self, std::uint32_t steps, double distance) {
  const auto rows = make_array<double>(steps, kColumns);
  double* row = rows.data();
  advance_and_see(self, steps, distance, [&](const Sample& sample) {
    write(sample, row);
    row += kColumns;
  });
  return rows;
}

void advance(SimulatedModule& self, std::uint32_t steps, double distance) {
  advance_and_see(self, steps, distance, [](const Sample&) {});
}

void set_broken(SimulatedModule& self, const std::string& name, bool broken) {
  for (const plant::PartInfo& part : plant::kParts) {
    if (name == part.name) {
      self.broken().*part.member = broken;
      return;
    }
  }
  throw nb::key_error(name.c_str());
}

// The frames in a stream by the firmware's parser, as (type, sequence, payload), and the number of bad ones.
nb::tuple parse_frames(const nb::bytes& stream) {
  firmware::FrameParser parser;
  Frame frame;
  nb::list frames;
  for (std::size_t i = 0; i < stream.size(); ++i) {
    if (parser.take(bytes_of(stream)[i], frame)) frames.append(tuple_of(frame));
  }
  return nb::make_tuple(frames, parser.bad_frames());
}

std::uint8_t one_byte(const char* what, long long number) {
  if (number < 0 || number > 0xFF) {
    throw std::invalid_argument("a frame's " + std::string(what) + " is one byte, 0 to 255; got " +
                                std::to_string(number));
  }
  return static_cast<std::uint8_t>(number);
}

// The bytes of a frame, by the firmware's function.
nb::bytes build_frame(long long type, long long sequence, const nb::bytes& payload) {
  if (payload.size() > firmware::kMaxPayload) {
    throw std::invalid_argument("a payload has at most " + std::to_string(firmware::kMaxPayload) + " bytes; got " +
                                std::to_string(payload.size()));
  }
  Frame frame;
  frame.type = one_byte("type", type);
  frame.sequence = one_byte("sequence", sequence);
  frame.size = static_cast<std::uint8_t>(payload.size());
  std::memcpy(frame.payload, payload.c_str(), payload.size());
  std::uint8_t bytes[firmware::kMaxFrame];
  return to_bytes(bytes, firmware::write_frame(frame, bytes));
}

nb::list parameters(const SimulatedModule& self) {
  nb::list values;
  for (std::size_t i = 0; i < firmware::kParameterCount; ++i) {
    values.append(self.module().parameters()[static_cast<firmware::Parameter>(i)]);
  }
  return values;
}

// A list of what `convert` makes of each row of a table.
template <class Table, class Convert>
nb::list list_of(const Table& table, const Convert& convert) {
  nb::list rows;
  for (const auto& row : table) rows.append(convert(row));
  return rows;
}

nb::list parameter_table() {
  return list_of(firmware::kParameters, [](const firmware::ParameterInfo& info) {
    return nb::make_tuple(info.name, info.unit, info.lower, info.upper, info.standard);
  });
}

nb::list plant_table() {
  return list_of(plant::kPlantTable, [](const plant::PlantInfo& info) {
    return nb::make_tuple(info.name, info.unit, info.lower, info.standard, info.about);
  });
}

nb::list plant_parts() {
  return list_of(plant::kParts, [](const plant::PartInfo& part) { return nb::str(part.name); });
}

// Row by event, column by state: (accepted, next state).
nb::list transition_table() {
  return list_of(firmware::kTransitions, [](const auto& row) {
    return list_of(row, [](const firmware::Transition& entry) {
      return nb::make_tuple(entry.accepted, static_cast<int>(entry.next));
    });
  });
}

}  // namespace

nb::tuple tuple_of(const Frame& frame) {
  return nb::make_tuple(frame.type, frame.sequence, to_bytes(frame.payload, frame.size));
}

void bind_firmware(nb::module_& module) {
  module.def("parse_frames", &parse_frames);
  module.attr("MAX_PAYLOAD") = firmware::kMaxPayload;
  module.attr("MAX_PIECE") = firmware::kMaxPiece;
  module.def("build_frame", &build_frame);
  module.def("parameter_table", &parameter_table);
  module.def("plant_table", &plant_table);
  module.def("plant_parts", &plant_parts);
  module.def("transition_table", &transition_table);
  module.def("step_microseconds", [] { return SimulatedModule::kStepMicroseconds; });
  nb::class_<SimulatedModule>(module, "SimulatedModule")
      .def("__init__",
           [](SimulatedModule* self, std::uint32_t serial_number, const nb::dict& plant, double distance,
              std::uint64_t seed, std::uint32_t start_us, std::uint8_t reason) {
             new (self) SimulatedModule(serial_number, plant_from(plant), distance, seed, start_us,
                                        static_cast<firmware::ResetReason>(reason));
           })
      .def("load",
           [](SimulatedModule& self, const nb::bytes& image) { return self.load(bytes_of(image), image.size()); })
      .def("stored",
           [](const SimulatedModule& self) { return to_bytes(self.stored().data(), self.stored().size()); })
      .def("receive", [](SimulatedModule& self, const nb::bytes& bytes,
                         std::uint32_t ahead_us) { self.receive(bytes_of(bytes), bytes.size(), ahead_us); })
      .def("overhear",
           [](SimulatedModule& self, const nb::bytes& bytes) { self.overhear(bytes_of(bytes), bytes.size()); })
      .def("transmit", &transmit)
      .def("close_link", &SimulatedModule::close_link)
      .def("advance", &advance)
      .def("trace", &trace)
      .def("sample", [](const SimulatedModule& self) { return fields(self.sample()); })
      .def("faults", [](const SimulatedModule& self) { return self.module().faults(); })
      .def("parameters", &parameters)
      .def("pause", &SimulatedModule::pause)
      .def("set_broken", &set_broken);
}

}  // namespace tensionlab
