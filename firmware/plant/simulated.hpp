// A module with its firmware and the hardware around it, stepped in lockstep by whoever owns it.
#pragma once

#include <cstring>
#include <vector>

#include "plant.hpp"

namespace tensionlab {
namespace plant {

// One line of a trace, after a step.
struct Sample {
  double seconds, distance, length, tension, commanded, current, brake_force, winding, estimated_winding;
  int state, limit;
  bool driver_on, pawl_down;
};

class SimulatedModule {
 public:
  // distance: of the far end at the start, m; the module's clock starts at start_us.
  SimulatedModule(std::uint32_t serial_number, const PlantParameters& parameters, double distance,
                  std::uint64_t seed, std::uint32_t start_us, firmware::ResetReason reason)
      : module_(serial_number, reason, firmware::board::kDriverHeat),
        plant_(parameters, distance, seed),
        distance_(distance),
        now_us_(start_us) {}

  // Settings as they were stored; false if they are damaged, and then the standard ones stay.
  bool load(const std::uint8_t* image, std::size_t size) {
    if (!module_.load(image, size)) return false;
    stored_.assign(image, image + size);
    return true;
  }

  // ahead_us: whoever serves the link reads the clock so much later than the last step did.
  void receive(const std::uint8_t* bytes, std::size_t size, std::uint32_t ahead_us) {
    module_.receive(bytes, size, now_us_ + ahead_us);
  }
  void overhear(const std::uint8_t* bytes, std::size_t size) { module_.overhear(bytes, size, now_us_); }
  void close_link() { module_.link_closed(now_us_); }
  std::size_t transmit(std::uint8_t* bytes, std::size_t room) { return module_.transmit(bytes, room); }

  // Steps on for some time, while the far end moves to `distance` at an even speed. trace(Sample) sees each step.
  template <class Trace>
  void advance(std::uint32_t steps, double distance, const Trace& trace) {
    if (steps == 0) return;
    const double start = distance_, speed = (distance - start) / (steps * kSeconds);
    for (std::uint32_t step = 1; step <= steps; ++step) {
      const std::uint32_t parts = kParts * (1 + pause_us_ / kStepMicroseconds);
      for (std::uint32_t part = 0; part < parts; ++part) {
        const double gone = (step - 1 + static_cast<double>(part) / parts) / steps;
        plant_.place_end(start + (distance - start) * gone, speed);
        plant_.advance(actuators_, module_.parameters(), kSeconds / kParts);
      }
      distance_ = start + (distance - start) * step / steps;
      now_us_ += kStepMicroseconds + pause_us_;
      seconds_ += kSeconds + 1e-6 * pause_us_;
      pause_us_ = 0;
      actuators_ = module_.step(plant_.sense(now_us_));
      do_chore();
      trace(sample());
    }
  }

  // The firmware's loop stands still for so long.
  void pause(std::uint32_t microseconds) { pause_us_ = microseconds; }

  Sample sample() const {
    return {seconds_,
            distance_,
            plant_.spool().out(),
            plant_.spool().tension(),
            static_cast<double>(module_.tension()),
            plant_.current(),
            plant_.spool().brake_force(),
            plant_.heat().winding,
            static_cast<double>(module_.heat().winding()),
            static_cast<int>(module_.state()),
            static_cast<int>(module_.limit()),
            actuators_.driver_on,
            plant_.spool().pawl_down()};
  }

  const firmware::Module& module() const { return module_; }
  const std::vector<std::uint8_t>& stored() const { return stored_; }
  Breakage& broken() { return plant_.broken; }

  static constexpr std::uint32_t kStepMicroseconds = 250;  // the firmware runs at 4 kHz

 private:
  static constexpr double kSeconds = 1e-6 * kStepMicroseconds;
  static constexpr std::uint32_t kParts = 2;  // of a step, for the plant

  void do_chore() {
    if (module_.chore() == firmware::Chore::store_parameters) {
      std::uint8_t image[firmware::Parameters::kImageSize];
      module_.parameters().write_image(image);
      stored_.assign(image, image + sizeof image);
      module_.chore_done(true, 0.0f);
    } else if (module_.chore() == firmware::Chore::align_encoder) {
      const double turn = 6.283185307179586, error = plant_.broken.encoder ? 0.0 : plant_.align();
      const double zero = static_cast<double>(module_.parameters()[firmware::Parameter::motor_zero]) + error;
      module_.chore_done(!plant_.broken.encoder, static_cast<float>(zero - turn * std::floor(zero / turn)));
    }
  }

  firmware::Module module_;
  Plant plant_;
  firmware::Actuators actuators_ = {false, 0.0f, 1000.0f};
  std::vector<std::uint8_t> stored_;
  double distance_, seconds_ = 0.0;
  std::uint32_t now_us_, pause_us_ = 0;
};

}  // namespace plant
}  // namespace tensionlab
