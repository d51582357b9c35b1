// A module on an ESP32: the core in a task of its own, which does nothing but turn the FOC loop.
#include <Arduino.h>
#include <esp_system.h>
#include <esp_task_wdt.h>
#include <stdio.h>

#include <optional>

#include "../core/module.hpp"
#include "alignment.hpp"
#include "board.hpp"
#include "brake_servo.hpp"
#include "kept_heat.hpp"
#include "link.hpp"
#include "settings.hpp"
#include "winch.hpp"

namespace {

using namespace tensionlab::firmware;

uint32_t serial_number() { return static_cast<uint32_t>(ESP.getEfuseMac() >> 16); }

ResetReason reset_reason() {
  switch (esp_reset_reason()) {
    case ESP_RST_POWERON:
      return ResetReason::power;
    case ESP_RST_SW:
      return ResetReason::software;
    case ESP_RST_TASK_WDT:
    case ESP_RST_INT_WDT:
    case ESP_RST_WDT:
      return ResetReason::watchdog;
    case ESP_RST_BROWNOUT:
      return ResetReason::brownout;
    default:
      return ResetReason::other;
  }
}

// The idle task of the FOC task's processor never runs, and is not watched; that of the other one may have to wait
// for Bluetooth.
void set_watchdog(bool driven) {
  const esp_task_wdt_config_t watchdog = {driven ? board::kDrivenWatchdog : board::kIdleWatchdog,
                                          driven ? 0u : 1u << board::kLinkCore, true};
  esp_task_wdt_reconfigure(&watchdog);
}

class Firmware {
 public:
  Firmware() : module_(serial_number(), reset_reason(), board::kDriverHeat) {}

  void begin() {
    if (!load_settings(module_)) module_.log("no settings in flash: standard ones");
    recall_heat(module_);
    if (!servo_.begin()) module_.log("servo: no channel");
    if (!winch_.begin()) module_.log("motor: driver or current sensing did not start");
    if (!link_.begin(serial_number())) module_.log("link: Bluetooth or a task did not start");
  }

  // One turn of the FOC loop. Nothing in it waits, but for a chore that the core asks for while the driver is off.
  void turn() {
    const Sensors sensors = winch_.turn(module_.parameters());
    uint8_t bytes[64];  // a few frames: a flood must not hold the loop up
    const size_t size = link_.receive(bytes, sizeof bytes);
    if (link_.take_closed()) module_.link_closed(sensors.now_us);
    module_.receive(bytes, size, sensors.now_us);
    module_.overhear(bytes, link_.overhear(bytes, sizeof bytes), sensors.now_us);
    const Actuators actuators = module_.step(sensors);
    guard(actuators.driver_on || alignment_);
    link_.allow_pairing(module_.state() == State::idle && !guarded_);
    winch_.apply(actuators, module_.parameters());
    servo_.move(actuators.brake_pulse_us);
    if (turns_++ % 64 == 0) keep_heat(module_.heat());
    do_chore(sensors);
    const size_t room = link_.room();
    link_.send(bytes, module_.transmit(bytes, room < sizeof bytes ? room : sizeof bytes));
  }

 private:
  // A hang is noticed soon while the driver is on.
  void guard(bool driven) {
    if (driven == guarded_) return;
    set_watchdog(driven);
    guarded_ = driven;
  }

  void do_chore(const Sensors& sensors) {
    if (module_.chore() == Chore::store_parameters) {
      module_.chore_done(store_settings(module_.parameters()), 0.0f);
    }
    // An emergency stop ends the alignment at once: the core then no longer waits for it, or is no longer idle.
    const bool wanted = module_.chore() == Chore::align_encoder && module_.state() == State::idle;
    if (wanted) {
      align(sensors);
    } else if (alignment_) {
      end_alignment("align: stopped", false);
    }
  }

  // A step of finding the electrical zero.
  void align(const Sensors& sensors) {
    if (!alignment_) alignment_.emplace(kMotor, sensors.now_us);
    if (!sensors.encoder_ok) return end_alignment("align: the encoder failed", false);
    const Alignment::Result result = alignment_->advance(sensors.now_us, winch_.measure_alignment());
    if (result == Alignment::Result::running) {
      winch_.hold(alignment_->wanted());
    } else {
      log_alignment();
      end_alignment(kFindings[static_cast<size_t>(result)], result == Alignment::Result::done);
    }
  }

  // What was measured, for the host's diagnosis, in percent of what is right.
  void log_alignment() {
    const auto percent = [](float share) { return static_cast<int>(100.0f * clamp(share, -9.0f, 9.0f)); };
    char text[kMaxPayload];
    snprintf(text, sizeof text, "align: forth %d %%, back %d %%, current %d %%", percent(alignment_->forth()),
             percent(alignment_->back()), percent(alignment_->current_share()));
    module_.log(text);
  }

  void end_alignment(const char* finding, bool success) {
    winch_.let_go();
    module_.log(finding);
    module_.chore_done(success, alignment_->zero());  // heard only if the core still waits for it
    alignment_.reset();
  }

  static constexpr Alignment::Motor kMotor = {
      board::kPolePairs, board::kPhaseResistance + board::kBridgeResistance, board::kAlignVoltage};
  // By Alignment::Result; 56 characters at most.
  static constexpr const char* kFindings[] = {"",
                                              "align: done",
                                              "align: no motion; is the supply on, the spool free?",
                                              "align: wrong way round; swap two motor wires",
                                              "align: wrong number of poles, or the spool slipped",
                                              "align: it did not come back; a pawl, a taut cable?",
                                              "align: currents do not fit; shunt R010/R006, phases?"};

  Module module_;
  Winch winch_;
  BrakeServo servo_;
  Link link_;
  std::optional<Alignment> alignment_;
  bool guarded_ = false;
  uint8_t turns_ = 0;
};

void turn_forever(void* firmware) {
  esp_task_wdt_add(nullptr);
  for (;;) {
    esp_task_wdt_reset();
    static_cast<Firmware*>(firmware)->turn();
  }
}

}  // namespace

// The watchdog has run out: what follows, the panic's print, takes long.
extern "C" void IRAM_ATTR esp_task_wdt_isr_user_handler(void) { Winch::cut(); }

void setup() {
  Winch::driver_off();
  static Firmware firmware;
  firmware.begin();
  set_watchdog(false);
  xTaskCreatePinnedToCore(turn_forever, "foc", board::kStack, &firmware, board::kFocPriority, nullptr,
                          board::kFocCore);
}

void loop() { vTaskDelete(nullptr); }
