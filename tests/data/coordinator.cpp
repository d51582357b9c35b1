// One module allocates for four: its frames go over the links of four simulated modules, which pull what it chose.
#include "firmware/coordinator/coordinator.hpp"

#include <cmath>
#include <cstdio>
#include <vector>

#include "firmware/plant/simulated.hpp"

using namespace tensionlab::firmware;
using tensionlab::plant::SimulatedModule;

namespace {

constexpr int kCables = 4;
constexpr uint16_t kSession = 7;

void send(SimulatedModule& module, Type type, uint8_t sequence, const Writer& writer, const uint8_t* payload) {
  Frame frame;
  frame.type = static_cast<uint8_t>(type);
  frame.sequence = sequence;
  frame.size = static_cast<uint8_t>(writer.size());
  memcpy(frame.payload, payload, writer.size());
  uint8_t bytes[kMaxFrame];
  module.receive(bytes, write_frame(frame, bytes), 0);
}

void step(SimulatedModule& module, uint32_t steps) {
  module.advance(steps, 1.0, [](const tensionlab::plant::Sample&) {});
}

void bring_up(SimulatedModule& module) {
  step(module, 100);
  const float values[] = {1.0F, 3.0F};  // length in m, newton per ampere
  uint8_t payload[kMaxPayload];
  for (uint8_t what = 0; what < 2; ++what) {
    Writer writer(payload);
    writer.u8(what);
    writer.f32(values[what]);
    send(module, Type::calibrate, 254, writer, payload);
  }
  Writer writer(payload);
  writer.u16(kSession);
  writer.u8(0);  // no stop since the start
  send(module, Type::arm, 0, writer, payload);
}

}  // namespace

int main() {
  const float side = 0.615457F, front = 0.492366F;
  const float structure[] = {-side, side, -side, side, -side, -side, side, side, -front, -front, -front, -front};
  const float lower[] = {0.5F, 0.5F, 0.5F, 0.5F}, upper[] = {5, 5, 5, 5};
  CoordinatorModule<3, kCables> coordinator(lower, upper, kSession, 100, 100);
  std::vector<SimulatedModule> modules;
  for (uint32_t i = 0; i < kCables; ++i) {
    modules.emplace_back(i, tensionlab::plant::standard_plant(), 1.0, i, 0, ResetReason::power);
    bring_up(modules.back());
  }
  uint8_t frames[kCables][kMaxFrame];
  size_t sizes[kCables];
  for (int cycle = 0; cycle < 600; ++cycle) {  // more than 256: sequence numbers begin again
    const float wrench[] = {std::sin(0.01F * static_cast<float>(cycle)), 0.5F, -4};
    const auto& answer = coordinator.command(structure, wrench, frames, sizes);
    for (size_t i = 0; i < kCables; ++i) {
      modules[i].receive(frames[i], sizes[i], 0);
      step(modules[i], 8);
      if (cycle % 100 != 99) continue;
      std::printf("%d %d %.6g %.6g\n", static_cast<int>(i), static_cast<int>(modules[i].module().state()),
                  static_cast<double>(answer.tensions[i]), static_cast<double>(modules[i].module().tension()));
    }
  }
}
