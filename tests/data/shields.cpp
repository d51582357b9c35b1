// shields: the firmware for one shield on simulated hardware with one: finds its electrical zero, then pulls 3 N
// for a while. Arguments: the version of the shield that is simulated, and the seed. Printed are what the
// alignment says; whether a command was refused; the tension in N at the end; and the supply voltage as measured,
// over the real one. In one piece, which compiles in a quarter of the time.
#include "core/answers.cpp"
#include "core/commands.cpp"
#include "core/module.cpp"
#include "dangers/story.cpp"
#include "esp32/kept_heat.cpp"
#include "esp32/link.cpp"
#include "esp32/winch.cpp"
#include "fakes/libraries.cpp"
#include "fakes/simplefoc.cpp"
#include "fakes/tasks.cpp"
// clang-format off: this one imports the firmware's names, which the fakes have as well
#include "esp32/main.cpp"
// clang-format on

int main(int, char** words) {
  using namespace tensionlab;
  dangers::Story story(std::strtoull(words[2], nullptr, 10), std::atoi(words[1]));
  story.zero_error = story.between(0.5, 5.5);  // which the alignment puts right
  story.boot();
  story.align();
  const std::string found = story.host().log;
  story.plant().spool().cut = false;
  story.plant().take_up_slack();
  story.begin();
  story.pull(3.0, 0.6);
  const double volts = 3.3 / 4095.0 * story.plant().convert(plant::CurrentSensing::Input::supply);
  std::printf("%s\n%d %.4f %.4f\n", found.c_str(), story.host().refused ? 1 : 0, story.plant().spool().tension(),
              volts * static_cast<double>(firmware::board::kSupplyDivider) / story.plant().supply_voltage());
  std::fflush(stdout);
  std::_Exit(0);
}
