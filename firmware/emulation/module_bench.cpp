// The core on a long stream of commands, sensors and mishaps: a hash of all that it sends and asks of the motor,
// its instructions for each step and each command, and its stack. The same program for this computer and for
// emulated processors (`python firmware/emulate.py`), which must print the same hash.
#include <new>

#include "commands.hpp"
#include "sensors.hpp"

#if !defined(STEPS)
#define STEPS 1000
#endif

namespace {

using namespace tensionlab::firmware;
using namespace tensionlab::emulation;

enum Kind { kStep, kTransmit, kTurn, kRestart, kCommand };  // and one for each type of command
constexpr int kKinds = kCommand + kCommandTypes;
constexpr const char* kNames[kKinds] = {
    "step",          "transmit",      "turn",          "restart",   "unknown", "hello",
    "arm",           "set_tension",   "set_impedance", "stop",      "estop",   "clear",
    "get_parameter", "set_parameter", "save",          "calibrate", "ping",    "configure_telemetry"};

// How often each number of ticks occurred.
class Counts {
 public:
  void add(uint32_t ticks) {
    ++counts_[ticks < kMost ? ticks : kMost];
    ++total_;
  }
  void print_as(const char* name) const {
    print(name, total_, "_count");
    print(name, quantile(total_ - total_ / 2), "_median");
    print(name, quantile(total_ - total_ / 1000), "_p999");
    print(name, quantile(total_), "_worst");
  }

 private:
  static constexpr uint32_t kMost = 1U << 15;

  // Instructions that so many of all did not exceed.
  uint32_t quantile(uint32_t rank) const {
    uint32_t ticks = 0, sum = counts_[0];
    while (sum < rank && ticks < kMost) sum += counts_[++ticks];
    return platform_instructions(ticks);
  }

  uint32_t counts_[kMost + 1] = {}, total_ = 0;
};

// What was reached: bits of states, limits, faults, brake's states, codes and types of messages.
struct Reached {
  uint32_t states = 0, limits = 0, faults = 0, brakes = 0, codes = 0, messages = 0;

  void look(const Module& module) {
    states |= 1U << static_cast<int>(module.state());
    limits |= 1U << static_cast<int>(module.limit());
    faults |= module.faults();
  }
  void read(const Frame& frame) {
    messages |= 1U << (frame.type & 31);
    if (frame.type == static_cast<uint8_t>(Type::acknowledge)) codes |= 1U << frame.payload[1];
    // In telemetry three numbers of two bytes follow the brake.
    if (frame.type == static_cast<uint8_t>(Type::telemetry)) brakes |= 1U << frame.payload[frame.size - 7];
  }
};

Counts counts[kKinds];

class Bench {
 public:
  void play(int steps) {
    fill_stack();
    for (int i = 0; i < 1000; ++i) {  // nothing but the counter
      const uint32_t ticks = ticks_since(platform_ticks());
      if (ticks < overhead_) overhead_ = ticks;
    }
    for (int i = 0; i < steps; ++i) {
      turn_ = 0;
      size_ = 0;
      happen();
      if (size_ > 0) measure(kind_, [&] { module_.receive(wire_, size_, sensors_.now_us()); });
      step();
      fetch();
      counts[kTurn].add(turn_);
    }
    const uint32_t stack = used_stack(caller_);
    print("hash", hash_.value());
    print("steps", static_cast<uint32_t>(steps));
    print("wraps", sensors_.wraps());
    print("states", reached_.states);
    print("limits", reached_.limits);
    print("faults", reached_.faults);
    print("brakes", reached_.brakes);
    print("codes", reached_.codes);
    print("messages", reached_.messages);
    print("object", sizeof module_);
    print("stack", stack);
    for (int kind = 0; kind < kKinds; ++kind) counts[kind].print_as(kNames[kind]);
  }

 private:
  enum class Phase { rest, prepare, work, end };

  template <class Call>
  void measure(int kind, Call call) {
    unsigned char* const frame = static_cast<unsigned char*>(__builtin_frame_address(0));
    if (frame > caller_) caller_ = frame;
    const uint32_t begin = platform_ticks();
    call();
    const uint32_t ticks = ticks_since(begin) - overhead_;
    counts[kind].add(ticks);
    if (kind != kRestart) turn_ += ticks;
  }

  // The command is received in this turn.
  void send(Type type) {
    size_ = commands_.write(type, module_.stops(), wire_);
    const int number = static_cast<int>(type);
    kind_ = kCommand + (number < kCommandTypes ? number : 0);
  }

  void step() {
    const Sensors& sensors = sensors_.sample(step_us_, actuators_, module_.parameters());
    measure(kStep, [&] { actuators_ = module_.step(sensors); });
    const float numbers[] = {actuators_.current, actuators_.brake_pulse_us, module_.tension()};
    const uint8_t bytes[] = {actuators_.driver_on, static_cast<uint8_t>(module_.state()),
                             static_cast<uint8_t>(module_.limit()), static_cast<uint8_t>(module_.faults())};
    hash_.add(numbers, sizeof numbers);
    hash_.add(bytes, sizeof bytes);
    reached_.look(module_);
  }

  // The link takes what there is, in pieces; now and then it stands still.
  void fetch() {
    if (random_.once_in(3000)) stalled_ = 300;
    if (stalled_ > 0 && --stalled_ > 0) return;
    uint8_t bytes[kMaxFrame];
    size_t size = 0;
    const size_t room = static_cast<size_t>(random_.below(sizeof bytes));
    measure(kTransmit, [&] { size = module_.transmit(bytes, room); });
    hash_.add(bytes, size);
    Frame frame;
    for (size_t i = 0; i < size; ++i) {
      if (answers_.take(bytes[i], frame)) reached_.read(frame);
    }
  }

  // A host's day: prepare and arm the module, work with it until something happens, rest, and begin again.
  void happen() {
    if (module_.chore() != Chore::none && random_.once_in(50)) {
      const bool success = !random_.once_in(4);
      module_.chore_done(success, random_.uniform(0.0F, 6.5F));
    }
    if (random_.once_in(60)) return send(any_command());
    if (left_ > 0) {
      --left_;
      if (phase_ == Phase::work) work();
      return;
    }
    switch (phase_) {
      case Phase::rest:
        phase_ = Phase::prepare;
        next_ = 0;
        break;
      case Phase::prepare:
        prepare();
        break;
      case Phase::work:
        phase_ = Phase::end;
        end();
        break;
      case Phase::end:
        phase_ = Phase::rest;
        sensors_.begin(Defect::none);
        left_ = 20 + random_.below(200);
        break;
    }
  }

  Type any_command() {
    static const Type often[] = {Type::hello,
                                 Type::ping,
                                 Type::arm,
                                 Type::get_parameter,
                                 Type::set_parameter,
                                 Type::calibrate,
                                 Type::configure_telemetry,
                                 Type::save,
                                 Type::clear};
    return random_.once_in(8) ? static_cast<Type>(random_.below(256)) : often[random_.below(9)];
  }

  void prepare() {
    static const Type script[] = {Type::clear,         Type::stop,
                                  Type::hello,         Type::ping,
                                  Type::set_parameter, Type::set_parameter,
                                  Type::get_parameter, Type::save,
                                  Type::calibrate,     Type::calibrate,
                                  Type::calibrate,     Type::configure_telemetry,
                                  Type::arm,           Type::arm};
    constexpr int kScript = sizeof script / sizeof script[0];
    if (next_ == 0) begin();
    // STOP lets the cable go slowly, and a chore takes its time.
    const bool lets_go = module_.state() == State::idle && module_.tension() > 0.0F;
    if ((lets_go || module_.chore() != Chore::none) && ++waited_ < 400) return;
    waited_ = 0;
    if (module_.state() != State::armed) send(script[next_]);
    left_ = random_.below(4);
    if (++next_ < kScript) return;
    phase_ = Phase::work;
    left_ = 100 + random_.below(700);
    defect_at_ = random_.once_in(3) ? 0 : left_ / 2 + random_.below(left_ / 2);
    if (defect_ == Defect::slack) {  // it takes a second to be noticed
      left_ = 600;
      defect_at_ = 500;
    }
  }

  // The duration of a step, and the next defect in turn.
  void begin() {
    static const int durations_us[] = {250, 250, 250, 250, 100, 1000, 2500};
    step_us_ = durations_us[random_.below(7)];
    defect_ = static_cast<Defect>((static_cast<int>(defect_) + 1) % static_cast<int>(Defect::count));
    if (defect_ == Defect::slack) step_us_ = 2500;
    impedance_ = random_.once_in(2);
  }

  void work() {
    if (left_ == defect_at_) sensors_.begin(defect_);
    if (random_.once_in(8)) send(impedance_ == random_.once_in(10) ? Type::set_tension : Type::set_impedance);
  }

  void end() {
    left_ = 50;
    switch (random_.below(8)) {
      case 0:
        return send(Type::estop);
      case 1:
        return module_.link_closed(sensors_.now_us());
      case 2:
        return overhear(random_.once_in(2) ? Type::stop : Type::estop);
      case 3:
        return restart();
      case 4:
        left_ = 3000;  // the set-point expires
        return;
      default:
        return send(Type::stop);
    }
  }

  void overhear(Type type) {
    const size_t size = commands_.write(type, module_.stops(), wire_);
    module_.overhear(wire_, size, sensors_.now_us());
  }

  // Power off and on, with the parameters as stored; now and then they are damaged.
  void restart() {
    uint8_t image[Parameters::kImageSize];
    module_.parameters().write_image(image);
    if (random_.once_in(4)) image[random_.below(sizeof image)] ^= 1;
    const ResetReason reason = static_cast<ResetReason>(random_.below(5));
    measure(kRestart, [&] {
      new (&module_) Module(7, reason);  // in its place: a second one would be on the stack
      module_.load(image, sizeof image);
    });
    answers_ = FrameParser();
  }

  Module module_{7, ResetReason::power};
  Random random_;
  Commands commands_{random_};
  SimulatedSensors sensors_{random_, 0U - 20000000U};  // the clock wraps around after 20 s
  Actuators actuators_ = {};
  FrameParser answers_;
  Reached reached_;
  Hash hash_;
  uint8_t wire_[kMaxFrame];
  size_t size_ = 0;
  int kind_ = 0;
  Phase phase_ = Phase::rest;
  Defect defect_ = Defect::none;
  bool impedance_ = false;
  int step_us_ = 250, left_ = 50, next_ = 0, waited_ = 0, defect_at_ = 0, stalled_ = 0;
  uint32_t overhead_ = 0xFFFFFF, turn_ = 0;
  unsigned char* caller_ = nullptr;
};

}  // namespace

extern "C" int bench(void) {
  static Bench bench;
  bench.play(STEPS);
  return 0;
}
