// The host's end of a link to a module: its latest telemetry and state, and the numbers of what it is sent.
//
// Bytes may come in by a thread that has no interpreter. Telemetry is kept here; all other messages are queued for
// Python, and so is telemetry that comes after one of them, so that their order stays.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <mutex>
#include <utility>
#include <vector>

#include "firmware/core/messages.hpp"
#include "hardware/descriptors.hpp"
#include "hardware/frame_decoder.hpp"

namespace tensionlab {

constexpr double kMaxLengthJump = 0.05;        // m that a length may differ from where the cable's speeds take it
constexpr double kMaxAcceleration = 100.0;     // m/s2 of a cable
constexpr std::uint32_t kRestarted = 1000000;  // us: a module's clock that has gone back by so much has restarted

struct Telemetry {
  static constexpr std::size_t kSize = 40;
  static constexpr std::uint8_t kMaxState = 5, kMaxLimit = 9, kMaxBrake = 4;

  std::uint8_t payload[kSize];
  std::uint32_t time_us;
  std::uint8_t state, limit, sequence, brake;
  std::uint16_t faults;
  float tension, current, length, speed, supply, thermal;
  double received;  // s, by the clock of the link

  // Whether a payload is one: of its length, and with codes that have a name.
  bool read(const std::uint8_t* bytes, std::size_t size) {
    if (size != kSize) return false;
    std::copy(bytes, bytes + size, payload);
    firmware::Reader reader(bytes, size);
    time_us = reader.u32();
    state = reader.u8();
    faults = reader.u16();
    limit = reader.u8();
    sequence = reader.u8();
    for (float* number : {&tension, &current, &length, &speed, &supply, &thermal}) *number = reader.f32();
    brake = reader.u8();
    return state <= kMaxState && limit <= kMaxLimit && brake <= kMaxBrake;
  }

  bool follows_set_points() const { return state == 1 || state == 2; }

  // Whether it can be true after what was reported before, if anything was.
  bool is_plausible(const Telemetry* before) const {
    for (const float number : {length, speed, tension, current, supply, thermal}) {
      if (!std::isfinite(number)) return false;
    }
    if (faults != 0) return false;
    if (before == nullptr) return true;
    // By the slower clock: that of a simulated module stands still while its computer gives it no time.
    const double seconds =
        std::max(1e-6 * static_cast<double>(time_us - before->time_us), received - before->received);
    const double mean_speed = 0.5 * (static_cast<double>(before->speed) + static_cast<double>(speed));
    const double jump = static_cast<double>(length) - (static_cast<double>(before->length) + mean_speed * seconds);
    return std::abs(jump) <= kMaxLengthJump + 0.25 * kMaxAcceleration * seconds * seconds;
  }
};

class Endpoint {
 public:
  static constexpr int kNoState = -1;
  static constexpr std::int64_t kNotSent = -1;

  // The numbers of set-points begin after this one.
  explicit Endpoint(std::uint8_t set_point) : set_point_(set_point), armed_(set_point) {}

  // Takes bytes that came at a time in s; whether something is queued for Python now.
  bool feed(const std::uint8_t* bytes, std::size_t size, double now) {
    const std::lock_guard<std::mutex> locked(mutex_);
    decoder_.feed(bytes, size, [&](const firmware::Frame& frame) {
      Telemetry telemetry;
      if (queue_.empty() && !python_decodes_ &&
          frame.type == static_cast<std::uint8_t>(firmware::Type::telemetry) &&
          telemetry.read(frame.payload, frame.size)) {
        keep(telemetry, now);
      } else {
        queue_.push_back(frame);
      }
    });
    return !queue_.empty();
  }

  // What was queued, which then is no more.
  std::vector<firmware::Frame> take_queue() {
    const std::lock_guard<std::mutex> locked(mutex_);
    return std::exchange(queue_, {});
  }

  // Takes telemetry that was queued; whether it was newer than the latest.
  bool take(const Telemetry& telemetry, double now) {
    const std::lock_guard<std::mutex> locked(mutex_);
    return keep(telemetry, now);
  }

  // The number of the next set-point: below, its sequence number, and above, how often those began again since
  // ARM.
  std::uint16_t next_set_point() {
    const std::lock_guard<std::mutex> locked(mutex_);
    return ++set_point_;
  }

  // The sequence number of the next ARM, from which on telemetry may say that it is followed.
  std::uint8_t next_arm() {
    const std::lock_guard<std::mutex> locked(mutex_);
    followed_ = false;
    return armed_ = static_cast<std::uint8_t>(set_point_ = (set_point_ + 1) & 0xFF);
  }

  struct Known {
    Telemetry latest, checked;
    std::uint64_t telemetries, checks;  // numbers of the latest, and of the one checked last; 0: none
    std::uint64_t stale, repeated, bad_frames;
    std::size_t kept;
    int state;
    std::uint16_t faults, session;
    bool followed, python_decodes, needs_attention;
  };

  Known known() const {
    const std::lock_guard<std::mutex> locked(mutex_);
    return {latest_,         checked_, telemetries_, checks_,  stale_,    repeated_,       decoder_.bad_frames(),
            decoder_.kept(), state_,   faults_,      session_, followed_, python_decodes_, needs_attention_};
  }

  void set_state(int state) {
    const std::lock_guard<std::mutex> locked(mutex_);
    state_ = state;
  }
  void set_faults(std::uint16_t faults) {
    const std::lock_guard<std::mutex> locked(mutex_);
    faults_ = faults;
  }
  void set_session(std::uint16_t session) {
    const std::lock_guard<std::mutex> locked(mutex_);
    session_ = session;
  }
  // Whether Python is to have all messages, telemetry too.
  void set_python_decodes(bool python_decodes) {
    const std::lock_guard<std::mutex> locked(mutex_);
    python_decodes_ = python_decodes;
  }
  // Whether Python knows of something wrong: a broken link, a refused set-point.
  void set_needs_attention(bool needs_attention) {
    const std::lock_guard<std::mutex> locked(mutex_);
    needs_attention_ = needs_attention;
  }
  // The descriptor of the link, for set-points; none from the return of this on if it is kNoDescriptor.
  void set_file(Descriptor file) {
    const std::lock_guard<std::mutex> locked(mutex_);
    file_ = file;
  }
  bool python_decodes() const {
    const std::lock_guard<std::mutex> locked(mutex_);
    return python_decodes_;
  }

  // Counts the latest telemetry as checked.
  void set_checked() {
    const std::lock_guard<std::mutex> locked(mutex_);
    check();
  }
  // The next check knows nothing of what was before.
  void clear_checked() {
    const std::lock_guard<std::mutex> locked(mutex_);
    checks_ = 0;
  }

  // Whether a module that is to follow set-points certainly does, and what it reports can be true: what is not
  // certain is for Python to find out. By the link's clock in s; set-points live for `ttl`.
  bool is_well(double now, double ttl) {
    const std::lock_guard<std::mutex> locked(mutex_);
    const bool follows = state_ == 1 || state_ == 2;
    if (needs_attention_ || !follows || telemetries_ == 0 || !(now - latest_.received <= ttl)) return false;
    if (latest_.thermal >= 1.0F) return false;
    if (telemetries_ != checks_) {
      if (!latest_.is_plausible(checks_ == 0 ? nullptr : &checked_)) return false;
      check();
    }
    return true;
  }

  enum class Sent { yes, no_link, not_a_number, in_part, broken };

  // Sends SET_TENSION; its number, which is kNotSent where it was not sent.
  std::pair<std::int64_t, Sent> send_tension(double tension, bool brake, std::uint16_t ttl_ms, int& error) {
    const std::lock_guard<std::mutex> locked(mutex_);
    if (file_ == kNoDescriptor) return {kNotSent, Sent::no_link};
    const auto number = static_cast<float>(tension);
    if (!std::isfinite(number)) return {kNotSent, Sent::not_a_number};
    firmware::Frame frame;
    frame.type = static_cast<std::uint8_t>(firmware::Type::set_tension);
    frame.sequence = static_cast<std::uint8_t>(++set_point_);
    firmware::Writer writer(frame.payload);
    writer.u16(session_);
    writer.f32(number);
    writer.u8(brake ? 1 : 0);
    writer.u16(ttl_ms);
    writer.u8(static_cast<std::uint8_t>(set_point_ >> 8));
    frame.size = static_cast<std::uint8_t>(writer.size());
    std::uint8_t bytes[firmware::kMaxFrame];
    const std::size_t size = firmware::write_frame(frame, bytes);
    const std::int64_t taken = write_now(file_, bytes, size, error);
    if (taken < 0) return {kNotSent, Sent::broken};
    if (taken != static_cast<std::int64_t>(size)) return {kNotSent, Sent::in_part};
    return {frame.sequence, Sent::yes};
  }

 private:
  // Whether it is newer than the latest: sent after it, or by a module that has restarted since.
  bool keep(const Telemetry& telemetry, double now) {
    if (telemetries_ > 0 && latest_.time_us - telemetry.time_us < kRestarted) {
      ++stale_;
      ++repeated_;
      return false;
    }
    repeated_ = 0;
    latest_ = telemetry;
    latest_.received = now;
    ++telemetries_;
    // Numbers alone do not tell: an idle module repeats the last of an earlier session, or 0.
    const auto since = static_cast<std::uint8_t>(telemetry.sequence - armed_);
    if (telemetry.follows_set_points() && since <= static_cast<std::uint8_t>(set_point_ - armed_))
      followed_ = true;
    state_ = telemetry.state;
    faults_ = telemetry.faults;
    return true;
  }

  void check() {
    checked_ = latest_;
    checks_ = telemetries_;
  }

  mutable std::mutex mutex_;
  FrameDecoder decoder_;
  std::vector<firmware::Frame> queue_;
  Telemetry latest_{}, checked_{};
  std::uint64_t telemetries_ = 0, checks_ = 0, stale_ = 0, repeated_ = 0;
  int state_ = kNoState;
  std::uint16_t faults_ = 0, session_ = 0, set_point_;
  std::uint8_t armed_;
  bool followed_ = false, python_decodes_ = false, needs_attention_ = false;
  Descriptor file_ = kNoDescriptor;
};

}  // namespace tensionlab
