#include "defects.hpp"

namespace tensionlab {
namespace dangers {

namespace {

using fakes::board;
using firmware::Parameter;

constexpr double kDegree = 0.017453292519943295;

void nothing(Story&) {}

template <int kDegrees>
void turn_zero(Story& story) {
  story.zero_error = story.either() * kDegrees * kDegree;
}

// By at least 30 electrical degrees beside whole turns of them.
void slip(Story& story) {
  double shaft = 0.0;
  do {
    shaft = story.between(3.0, 90.0);
  } while (std::fabs(std::remainder(11.0 * shaft, 360.0)) < 30.0);
  story.plant().faults.slip = story.either() * shaft * kDegree;
}

void set(Story& story, Parameter index, double value) {
  story.host().set_parameter(index, value);
  story.rest(0.02);
}

// Another host has armed it, or was here before.
void arm(Story& story) {
  set(story, Parameter::ttl, 2000.0);
  story.pull(0.5, 0.1);
}

void expire(Story& story) {
  arm(story);
  story.speaking = false;
  story.rest(2.5);
}

void fault(Story& story) {
  arm(story);
  story.plant().faults.stuck = 1;
  story.rest(0.05);
  story.plant().faults.stuck = -1;
  story.rest(0.2);
}

}  // namespace

const Defect kDefects[] = {
    {"none", nothing, nothing},
    // How it was set up.
    {"flash-empty", [](Story& story) { story.set_up = false; }, nothing},
    {"not-calibrated", nothing, [](Story& story) { set(story, Parameter::calibrated, 0.0); }},
    {"direction", [](Story& story) { story.direction_error = -1.0; }, nothing},
    {"zero-60", turn_zero<60>, nothing},
    {"zero-120", turn_zero<120>, nothing},
    {"zero-180", turn_zero<180>, nothing},
    {"pulses", nothing, [](Story& story) { set(story, Parameter::brake_closed_pulse, 1000.0); }},
    {"load", nothing, [](Story& story) { set(story, Parameter::brake_on_fault, 1.0); }},
    // Encoder.
    {"slipped", nothing, slip},
    {"encoder-dead", nothing, [](Story& story) { story.plant().faults.stuck = story.below(2); }},
    {"encoder-damaged", nothing, [](Story& story) { story.plant().faults.garbled = story.between(0.3, 1.0); }},
    {"encoder-stuck", nothing, [](Story& story) { story.plant().faults.frozen = true; }},
    {"encoder-noisy", nothing,
     [](Story& story) { story.plant().faults.encoder_noise = story.between(200.0, 800.0); }},
    // Motor and driver.
    {"wire", nothing, [](Story& story) { story.plant().motor().cut_phase = story.below(3); }},
    {"driver", nothing, [](Story& story) { story.plant().faults.driver = true; }},
    {"swapped", [](Story& story) { story.hardware.swapped = true; }, nothing},
    {"poles", [](Story& story) { story.hardware.pole_pairs = 7 * (1 + story.below(2)); }, nothing},
    {"held", [](Story& story) { story.hardware.plant.dry_friction = 10.0; }, nothing},
    {"pawl", nothing,
     [](Story& story) {
       story.plant().brake = 1.0;
       story.rest(0.1);
       story.plant().faults.servo = true;
     }},
    {"cable-cut", nothing, [](Story& story) { story.plant().spool().cut = true; }},
    // Currents and supply.
    {"shunt", [](Story& story) { story.hardware.sensing.shunt = 0.006; }, nothing},
    {"sign", [](Story& story) { story.hardware.sensing.sign_b = 1.0; }, nothing},
    {"amplifiers", [](Story& story) { story.hardware.sensing.middle = story.hardware.sensing.gain = 0.0; },
     nothing},
    {"converter", nothing, [](Story& story) { story.plant().faults.converter = true; }},
    {"supply-off", nothing,
     [](Story& story) {
       story.plant().supply().set_source(0.0);
       story.rest(3.0);
     }},
    {"supply-low", nothing,
     [](Story& story) {
       story.plant().supply().set_source(5.0);
       story.rest(1.0);
     }},
    {"supply-high", nothing,
     [](Story& story) {
       story.plant().supply().set_source(18.0);
       story.rest(0.1);
     }},
    {"supply-weak", [](Story& story) { story.hardware.supply.resistance = 8.0; }, nothing},
    // The processor.
    {"loop", nothing, [](Story&) { board.turn_us = 1000; }},
    {"watchdog", [](Story&) { board.reset_reason = ESP_RST_TASK_WDT; }, nothing},
    {"brownout", [](Story&) { board.reset_reason = ESP_RST_BROWNOUT; }, nothing},
    // What happened before.
    {"armed", nothing, arm},
    {"timeout", nothing, expire},
    {"fault", nothing, fault},
    {"estop", nothing,
     [](Story& story) {
       story.host().estop();
       story.rest(0.02);
     }},
};
const int kDefectCount = static_cast<int>(sizeof kDefects / sizeof *kDefects);

}  // namespace dangers
}  // namespace tensionlab
