// One run of the ESP32's firmware on hardware that a seed draws: it boots, a host lets it pull, and something
// happens.
#pragma once

#include <cmath>
#include <functional>

#include "core/monitor.hpp"
#include "fakes/board.hpp"
#include "host.hpp"
#include "plant/noise.hpp"
#include "plant/shields.hpp"

namespace tensionlab {
namespace dangers {

// How the hand at the cable's far end moves: m/s out, by the seconds since the cable was taut.
using Hand = std::function<double(double)>;

class Story {
 public:
  // On the shield of this version.
  explicit Story(std::uint64_t seed, int shield = 2);

  double between(double lower, double upper) { return lower + (upper - lower) * random_.uniform(); }
  int below(int count) { return static_cast<int>(between(0.0, count)); }
  double either() { return below(2) == 0 ? -1.0 : 1.0; }

  // Before boot(): what it is made of, and how it was set up.
  plant::HardwareParameters hardware;
  double zero_error = 0.0;       // of the setting motor_zero, rad
  double direction_error = 1.0;  // of the setting motor_direction
  bool by_bluetooth = false;
  double speed_limit = 1.5;  // m/s
  bool set_up = true;        // a host sets the parameters, or they stay the standard ones
  bool thermistor = false;   // is fitted
  // Of the winding, and what is kept of it in memory that survives a reset; nothing after a loss of power.
  enum class Warmth { cold, hot } winding = Warmth::cold;
  bool kept = false;

  // Boots, rests for `seconds`, and takes the settings. The cable is held taut from then on.
  void boot(double seconds = 0.4);
  // Arms, and pulls with `tension` N at rest for `seconds`.
  void pull(double tension, double seconds = 0.3);
  // Lets time pass, with set-points if the host says any.
  void rest(double seconds) { advance(seconds); }
  // Lets the module look for its electrical zero.
  void align();
  // What happens, happens now: from here on is measured.
  void begin();
  // Goes on, with set-points if the host says any, until the module has let go or `seconds` are over.
  void watch(double seconds);

  Hand hand;
  bool speaking = true;                     // the host sends set-points
  bool brake = false;                       // that they ask for
  double tension = 0.0;                     // N, of the set-points
  std::function<void()> meanwhile = [] {};  // every 5 ms of watch()

  Host& host() { return host_; }
  plant::Hardware& plant();
  double seconds() const;  // since begin()

  // Since begin().
  double let_go_after = -1.0;                      // s until the driver went off; negative if it did not
  double reported_after = -1.0;                    // s until a line of text came
  double weak_after = 0.0;                         // s until it pulled no more than the minimum tension
  double most_tension = 0.0, least_tension = 1e9;  // N
  double hottest = 0.0;                            // winding, °C
  bool accepted = true;                            // all that the host had said before

 private:
  void set_parameters();
  void advance(double seconds);
  void note_turn();
  void warm();

  plant::Noise random_;
  Host host_{fakes::board.usb, 77};
  std::uint64_t begun_us_ = 0, taut_us_ = 0;
  double next_set_point_ = 0.0;
  bool armed_ = false, begun_ = false, driven_ = false;
};

}  // namespace dangers
}  // namespace tensionlab
