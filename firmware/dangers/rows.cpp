#include "rows.hpp"

#include <cmath>

namespace tensionlab {
namespace dangers {

namespace {

using fakes::board;
using firmware::kFaultCable;
using firmware::kFaultCurrent;
using firmware::kFaultEncoder;
using firmware::kFaultMotor;
using firmware::kFaultSpeed;
using firmware::kFaultSupply;

constexpr double kDegree = 0.017453292519943295;

// A hand that swings to and fro, up to 0.3 to 0.6 m/s.
void sway(Story& story) {
  const double fastest = story.between(0.3, 0.6), turns = 6.283185307179586 * story.between(0.5, 1.0);
  const double start = story.between(0.0, 6.28);
  story.hand = [=](double seconds) {
    return fastest * std::fmin(seconds / 0.2, 1.0) * std::sin(turns * seconds + start);
  };
}

// A hand that pulls cable out from some time on.
Hand pull_out(double from, double fastest, double until = 10.0) {
  return [=](double seconds) {
    if (seconds < from || seconds > until) return 0.0;
    return fastest * std::fmin((seconds - from) / 0.06, 1.0);
  };
}

// Boots, pulls with `tension` while the hand rests or sways, and then something happens.
template <class Happening>
void at_work(Story& story, double tension, bool moving, double seconds, const Happening& happening) {
  story.boot();
  if (moving) sway(story);
  story.pull(tension, story.between(0.25, 0.5));
  story.begin();
  happening();
  story.watch(seconds);
}

void cut(Story& story, double tension) {
  story.kept = true;  // that the winding is cold
  story.boot();
  story.pull(tension);
  story.begin();
  story.plant().spool().cut = true;
  story.watch(1.2);
}

void wrong_direction(Story& story, double tension) {
  story.direction_error = -1.0;
  story.boot();
  story.begin();
  story.pull(tension, 0.0);
  story.watch(4.0);
}

void wrong_zero(Story& story, double degrees, bool moving) {
  story.zero_error = story.either() * degrees * kDegree;
  story.boot();
  const double tension = story.between(0.5, moving ? 1.5 : 3.0);
  if (moving) story.hand = pull_out(0.35, story.between(0.4, 0.5) + 0.4 * tension);
  story.pull(tension, moving ? 0.34 : 0.01);
  story.begin();
  story.watch(0.5);
}

void slip(Story& story) {
  // By 8 to 90 degrees of the shaft, and at least 90 electrical degrees beside whole turns of them.
  double shaft = 0.0, electrical = 0.0;
  do {
    shaft = story.between(8.2, 90.0);
    electrical = std::remainder(11.0 * shaft, 360.0);
  } while (std::fabs(electrical) < 90.0);
  shaft *= story.either() * kDegree;
  at_work(story, story.between(1.0, 3.0), true, 1.5, [&] { story.plant().faults.slip = shaft; });
}

void noisy_line(Story& story) {
  at_work(story, 2.5, true, 0.5, [&] { story.plant().faults.garbled = story.between(0.3, 1.0); });
}

void stall(Story& story) {
  at_work(story, 2.5, true, 0.5,
          [&] { board.stall_us = static_cast<std::uint64_t>(story.between(6000.0, 40000.0)); });
}

// A magnet that is loose does not turn.
void stay(Story& story) {
  story.boot();
  story.hand = pull_out(0.35, story.between(0.8, 1.5));
  story.pull(2.5, 0.34);
  story.begin();
  story.plant().faults.frozen = true;
  story.watch(0.5);
}

// The capacitors are charged by the motor, as the source takes nothing back.
void overvoltage(Story& story) {
  story.speed_limit = 2.2;
  story.boot();
  story.hand = pull_out(0.35, story.between(2.6, 3.2), 1.2);
  story.pull(story.between(2.0, 3.0), 0.34);
  story.begin();
  story.watch(0.8);
}

// The button was pressed before, and a stranger asks all the time; storing its key would stop the loop.
void stranger(Story& story) {
  story.boot();
  board.pressed = true;
  story.pull(2.0, 0.3);
  story.begin();
  story.meanwhile = [] {
    if (board.pairable) board.stall_us = 30000;
  };
  story.watch(0.6);
}

void silent_host(Story& story, bool by_bluetooth, bool closes) {
  story.by_bluetooth = by_bluetooth;
  at_work(story, 2.5, true, 3.0, [&] {
    story.speaking = false;
    if (closes) board.air.connected = false;
  });
}

// A second host says its own set-points over the link that is not in use.
void second_host(Story& story) {
  story.by_bluetooth = true;
  Host other(board.usb, 99);
  story.meanwhile = [&other] {
    other.arm();
    other.pull(6.0, false);
  };
  at_work(story, 2.0, false, 1.0, [] {});
}

void other_takes_the_link(Story& story) {
  story.by_bluetooth = false;
  Host other(board.air, 99);
  at_work(story, 2.5, true, 3.0, [&] {
    board.air.connected = true;
    other.pull(6.0, false);
  });
}

void shift_offset(Story& story, bool at_start) {
  story.boot();
  story.pull(2.0, 0.4);
  if (!at_start) story.plant().sensing().shift += story.either() * 0.025;
  story.begin();
  story.watch(0.6);
}

void six_newtons(Story& story, double rest, double seconds) {
  story.boot(rest);
  story.pull(6.0, 0.2);
  story.begin();
  story.watch(seconds);
}

void thermistor_fails(Story& story, double factor) {
  story.thermistor = true;
  at_work(story, 2.5, true, 1.0, [&] { story.plant().faults.thermistor = factor; });
}

void brake_stays_open(Story& story) {
  story.boot();
  story.plant().faults.servo = true;
  story.brake = true;
  story.hand = pull_out(0.5, 0.2);
  story.pull(1.0, 0.49);
  story.begin();
  story.watch(0.6);
}

void brake_stays_closed(Story& story) {
  story.boot();
  story.brake = true;
  story.hand = pull_out(0.8, 0.1, 0.86);
  story.pull(1.0, 0.4);
  story.plant().faults.servo = true;
  story.brake = false;
  story.begin();
  story.watch(0.8);
}

void align_and_pull(Story& story) {
  story.zero_error = story.between(0.5, 5.5);  // which the alignment puts right
  story.boot();
  story.align();
  story.plant().spool().cut = false;
  story.plant().take_up_slack();
  story.begin();
  story.pull(1.0, 0.2);
  story.begin();
  story.watch(0.4);
}

template <class Change>
void aligned(Story& story, const Change& change) {
  change();
  story.boot();
  story.align();
}

}  // namespace

const Row kRows[] = {
    {"The cable is cut at 0.5 N", "driver off", Outcome::let_go, kFaultCable, 0.75, 0.0,
     [](Story& story) { cut(story, 0.5); }},
    {"The cable is cut at 1 N", "driver off", Outcome::let_go, kFaultCable | kFaultSpeed, 0.75, 0.0,
     [](Story& story) { cut(story, 1.0); }},
    {"The cable is cut at 3 N", "driver off", Outcome::let_go, kFaultSpeed, 0.05, 0.0,
     [](Story& story) { cut(story, 3.0); }},
    {"The cable is cut at 6 N", "driver off", Outcome::let_go, kFaultSpeed | kFaultMotor, 0.05, 0.0,
     [](Story& story) { cut(story, 6.0); }},
    {"`motor_direction` is wrong, 3 N, either way round", "driver off", Outcome::let_go, kFaultSpeed | kFaultMotor,
     0.1, 1.0, [](Story& story) { wrong_direction(story, 3.0); }},
    {"`motor_direction` is wrong, 0.5 N, either way round", "driver off", Outcome::let_go, kFaultCable, 3.5, 1.0,
     [](Story& story) { wrong_direction(story, 0.5); }},
    {"The electrical zero is off by 60 degrees",
     "driver off once the cable is pulled: at 0.6 m/s with 0.5 N, 1 m/s with 1.5 N", Outcome::let_go, kFaultMotor,
     0.1, 4.0, [](Story& story) { wrong_zero(story, 60.0, true); }},
    {"The electrical zero is off by 120 degrees", "driver off", Outcome::let_go, kFaultMotor | kFaultSpeed, 0.1,
     1.0, [](Story& story) { wrong_zero(story, 120.0, false); }},
    {"The electrical zero is off by 180 degrees", "driver off", Outcome::let_go, kFaultMotor | kFaultSpeed, 0.1,
     1.0, [](Story& story) { wrong_zero(story, 180.0, false); }},
    {"The magnet slips by 90 electrical degrees or more while the hand moves", "driver off", Outcome::let_go,
     kFaultMotor | kFaultSpeed | kFaultCurrent, 1.2, 5.0, slip},
    {"The encoder's data line is stuck", "driver off", Outcome::let_go, kFaultEncoder | kFaultSpeed, 0.005, 4.0,
     [](Story& story) { at_work(story, 2.5, true, 0.5, [&] { story.plant().faults.stuck = story.below(2); }); }},
    {"3 in 10 or more of the encoder's frames are damaged", "driver off", Outcome::let_go, kFaultEncoder, 0.05,
     4.0, noisy_line},
    {"The encoder's angle is stuck while a hand pulls at 0.8 m/s or more", "driver off", Outcome::let_go,
     kFaultMotor | kFaultSpeed | kFaultCurrent, 0.2, 7.0, stay},
    {"The encoder's angle jitters by 200 to 800 counts", "driver off", Outcome::let_go,
     kFaultMotor | kFaultSpeed | kFaultCurrent, 0.5, 6.0,
     [](Story& story) {
       at_work(story, 2.5, true, 0.5, [&] { story.plant().faults.encoder_noise = story.between(200.0, 800.0); });
     }},
    {"A motor wire comes off", "driver off", Outcome::let_go, kFaultMotor | kFaultCurrent, 0.5, 5.0,
     [](Story& story) {
       at_work(story, story.between(1.0, 3.0), true, 1.0,
               [&] { story.plant().motor().cut_phase = story.below(3); });
     }},
    {"The driver gives no voltage", "driver off", Outcome::let_go, kFaultMotor | kFaultCurrent, 0.3, 4.0,
     [](Story& story) { at_work(story, 2.5, true, 1.0, [&] { story.plant().faults.driver = true; }); }},
    {"The motor supply sinks to 5 V", "driver off", Outcome::let_go, kFaultSupply, 0.1, 4.0,
     [](Story& story) { at_work(story, 2.5, true, 1.0, [&] { story.plant().supply().set_source(5.0); }); }},
    {"The motor supply is cut", "driver off", Outcome::let_go, kFaultSupply | kFaultMotor | kFaultCurrent, 0.2,
     4.0, [](Story& story) { at_work(story, 2.5, true, 1.0, [&] { story.plant().supply().set_source(0.0); }); }},
    {"A hand pulls at 3 m/s: its power raises the supply, which takes nothing back", "driver off", Outcome::let_go,
     kFaultSupply, 0.6, 8.0, overvoltage},
    {"The converter stops answering", "driver off", Outcome::let_go, kFaultCurrent, 0.01, 4.0,
     [](Story& story) { at_work(story, 2.5, true, 0.5, [&] { story.plant().faults.converter = true; }); }},
    {"The loop hangs while the hand moves", "the watchdog takes the driver off", Outcome::let_go, 0, 0.03, 5.0,
     [](Story& story) { at_work(story, 2.5, true, 0.5, [&] { board.hanging = true; }); }},
    {"Flash is written while it pulls (settings, a radio key): 6 to 40 ms", "driver off", Outcome::let_go, 0, 0.03,
     8.0, stall},
    {"The radio is lost", "minimum tension, driver off 2 s later", Outcome::times_out, 0, 0.4, 4.0,
     [](Story& story) { silent_host(story, true, false); }},
    {"The host at USB stops sending", "minimum tension, driver off 2 s later", Outcome::times_out, 0, 0.4, 4.0,
     [](Story& story) { silent_host(story, false, false); }},
    {"The Bluetooth connection closes", "minimum tension, driver off 2 s later", Outcome::times_out, 0, 0.15, 4.0,
     [](Story& story) { silent_host(story, true, true); }},
    {"A second host takes the link by Bluetooth", "minimum tension, driver off 2 s later", Outcome::times_out, 0,
     0.15, 4.0, other_takes_the_link},
    {"A second host asks for 6 N over the other link", "continues with 2 N", Outcome::goes_on, 0, 0.0, 2.4,
     second_host, 1.6},
    {"A stranger asks to pair while it pulls", "continues, does not pair", Outcome::goes_on, 0, 0.0, 2.4, stranger,
     1.6},
    {"The radio shifts the converter by 25 mV as it starts; 2 N", "continues: the offset is measured at rest",
     Outcome::goes_on, 0, 0.0, 2.3, [](Story& story) { shift_offset(story, true); }, 1.7},
    {"The radio shifts the converter by 25 mV while the module pulls 2 N", "continues: cannot be detected",
     Outcome::goes_on, 0, 0.0, 2.5, [](Story& story) { shift_offset(story, false); }, 1.5},
    {"Power off and on with a hot winding; then 6 N are asked for", "continues with the continuous current",
     Outcome::goes_on, 0, 0.0, 3.6,
     [](Story& story) {
       story.winding = Story::Warmth::hot;
       six_newtons(story, 0.4, 3.0);
     },
     2.0},
    {"A restart with a hot winding; then 6 N are asked for",
     "continues with the continuous current: the temperature is kept", Outcome::goes_on, 0, 0.0, 3.6,
     [](Story& story) {
       story.winding = Story::Warmth::hot;
       story.kept = true;
       six_newtons(story, 0.4, 3.0);
     },
     2.0},
    {"A restart with a cold winding; then 6 N are asked for", "continues with 6 N: the temperature is kept",
     Outcome::goes_on, 0, 0.0, 6.5,
     [](Story& story) {
       story.kept = true;
       six_newtons(story, 0.4, 3.0);
     },
     4.4},
    {"Power off and on with a cold winding and a thermistor; then 6 N are asked for",
     "continues with 6 N after 6 s of rest", Outcome::goes_on, 0, 0.0, 6.5,
     [](Story& story) {
       story.thermistor = true;
       six_newtons(story, 6.0, 0.8);
     },
     4.4},
    {"The thermistor's wire breaks", "reports it, continues with the estimate", Outcome::reports, 0, 0.15, 4.0,
     [](Story& story) { thermistor_fails(story, INFINITY); }, 0.0, "thermistor: broken"},
    {"The thermistor is shorted", "reports it, continues with the estimate", Outcome::reports, 0, 0.15, 4.0,
     [](Story& story) { thermistor_fails(story, 0.0); }, 0.0, "thermistor: shorted"},
    {"The brake is stuck open; a hand pulls at 0.2 m/s", "reports it, continues with 1 N", Outcome::reports, 0,
     0.15, 1.6, brake_stays_open, 0.4, "brake: on, but the cable pays out"},
    {"The brake is stuck closed; a hand pulls 6 mm",
     "continues: cannot be detected, the brake holds the hand's pull", Outcome::goes_on, 0, 0.0, 50.0,
     brake_stays_closed},
    {"Two of the motor's wires are swapped", "calibration fails and says why", Outcome::refused, 0, 3.6, 0.0,
     [](Story& story) { aligned(story, [&] { story.hardware.swapped = true; }); }, 0.0, "wrong way round"},
    {"The shunts are R006 in place of R010", "calibration fails and says why", Outcome::refused, 0, 3.6, 0.0,
     [](Story& story) { aligned(story, [&] { story.hardware.sensing.shunt = 0.006; }); }, 0.0,
     "currents do not fit"},
    {"The second current amplifier has the wrong sign", "calibration fails and says why", Outcome::refused, 0, 3.6,
     0.0, [](Story& story) { aligned(story, [&] { story.hardware.sensing.sign_b = 1.0; }); }, 0.0,
     "currents do not fit"},
    {"The current amplifiers have no 3.3 V", "calibration fails and says why", Outcome::refused, 0, 3.6, 0.0,
     [](Story& story) {
       aligned(story, [&] { story.hardware.sensing.middle = story.hardware.sensing.gain = 0.0; });
     },
     0.0, "currents do not fit"},
    {"The motor has 7 or 14 pole pairs", "calibration fails and says why", Outcome::refused, 0, 3.6, 0.0,
     [](Story& story) { aligned(story, [&] { story.hardware.pole_pairs = 7 * (1 + story.below(2)); }); }, 0.0,
     "wrong number of poles"},
    {"The spool is held", "calibration fails and says why", Outcome::refused, 0, 3.6, 0.0,
     [](Story& story) { aligned(story, [&] { story.hardware.plant.dry_friction = 10.0; }); }, 0.0, "no motion"},
    {"A motor wire is off from the start", "calibration fails and says why", Outcome::refused, 0, 3.6, 0.0,
     [](Story& story) {
       story.boot();
       story.plant().motor().cut_phase = story.below(3);
       story.align();
     },
     0.0, "align: "},
    {"Nothing is wrong: it finds its electrical zero, then pulls 1 N", "continues", Outcome::goes_on, 0, 0.0, 1.3,
     align_and_pull, 0.7},
    {"Nothing is wrong: a hand swings to and fro", "continues", Outcome::goes_on, 0, 0.0, 4.0,
     [](Story& story) { at_work(story, story.between(0.5, 2.5), true, 1.0, [] {}); }},
};
const int kRowCount = static_cast<int>(sizeof kRows / sizeof *kRows);

}  // namespace dangers
}  // namespace tensionlab
