// A motor that is drawn along by a voltage, with friction: prints what the alignment makes of it.
// Arguments: poles (pairs), zero (rad), friction (share of the pull), way (1 or -1), shunt (told over true), sign
// (of the second current), resistance (ohm).
#include "alignment.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>

using tensionlab::firmware::Alignment;

int main(int, char** words) {
  const double poles = std::atof(words[1]), zero = std::atof(words[2]), friction = std::atof(words[3]);
  const double way = std::atof(words[4]), shunt = std::atof(words[5]), sign = std::atof(words[6]);
  const double resistance = std::atof(words[7]), tau = 6.283185307179586;
  const uint32_t start = 0xFFFFFF00u;  // the clock wraps around meanwhile
  Alignment alignment({11, 2.8f, 2.0f}, start);
  double rotor = 5.0;  // over all turns, rad
  Alignment::Result result = Alignment::Result::running;
  double most = 0.0;
  uint32_t now = start;
  for (; result == Alignment::Result::running; now += 250) {
    const Alignment::Wanted wanted = alignment.wanted();
    const double volts = static_cast<double>(wanted.voltage), electrical = static_cast<double>(wanted.electrical);
    most = std::fmax(most, volts);
    // The field that the motor feels; wires swapped, it turns the other way.
    const double field = way * (electrical + tau / 4.0);
    // The rotor moves as long as the field pulls it harder than the friction holds it.
    if (volts > 0.1 && friction < 1.0) {
      const double lag = std::remainder(field - (poles * rotor - zero), tau), held = std::asin(friction);
      if (std::fabs(lag) > held) rotor += (lag - std::copysign(held, lag)) / poles;
    }
    const double a = -std::sin(electrical) * volts / resistance, beta = std::cos(electrical) * volts / resistance;
    const double b = sign * (-0.5 * a + 0.8660254037844386 * beta);
    Alignment::Measured measured;
    measured.angle = static_cast<float>(rotor);
    measured.alpha = static_cast<float>(shunt * a);
    measured.beta = static_cast<float>(shunt * (a + 2.0 * b) / 1.7320508075688772);
    result = alignment.advance(now, measured);
  }
  std::printf("%d %.6f %.6f %.6f %.6f\n", static_cast<int>(result), static_cast<double>(alignment.zero()),
              static_cast<double>(alignment.current_share()), most, 1e-6 * (now - start));
}
