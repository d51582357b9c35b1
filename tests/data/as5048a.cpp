// A chip that speaks as the data sheet says, and the class that reads it: prints what becomes of each reading.
#include "as5048a.hpp"

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "plant/encoder_chip.hpp"

// Arguments are done in turn: an angle 0 to 16383, or flip (a bit of the angle's answer), garble (a command),
// stuck-low, stuck-high, weak, strong, found. After each: ok, count, magnitude, gain, errors.
int main(int count, char** words) {
  tensionlab::plant::EncoderChip chip;
  tensionlab::firmware::As5048a encoder;
  for (int word = 1; word < count; ++word) {
    const char* const what = words[word];
    if (std::strcmp(what, "weak") == 0) chip.diagnostics = 0x09FF;
    if (std::strcmp(what, "strong") == 0) chip.diagnostics = 0x0500;
    if (std::strcmp(what, "unready") == 0) chip.diagnostics = 0x0000;
    if (std::strcmp(what, "found") == 0) chip.diagnostics = 0x0180;
    if (what[0] >= '0' && what[0] <= '9') chip.angle = static_cast<uint16_t>(std::atoi(what));
    int frames = 0;
    const bool ok = encoder.read([&](uint16_t frame) -> uint16_t {
      ++frames;
      if (std::strcmp(what, "garble") == 0 && frames == 1) frame = static_cast<uint16_t>(frame ^ 0x0010);
      uint16_t answer = chip.exchange(frame);
      if (std::strcmp(what, "flip") == 0 && frames == 2) answer = static_cast<uint16_t>(answer ^ 0x0200);
      if (std::strcmp(what, "stuck-low") == 0) answer = 0;
      if (std::strcmp(what, "stuck-high") == 0) answer = 0xFFFF;
      return answer;
    });
    std::printf("%d %d %d %d %d\n", ok, encoder.count(), encoder.magnitude(), encoder.gain(), encoder.errors());
  }
}
