// The host's end of a link to a module: its latest telemetry and state, and the numbers of what it is sent; and
// the reader of all links.
//
// Bytes may come from a thread without the interpreter's lock. Telemetry is stored here; all other messages are
// queued for Python, and so is telemetry that comes after one of them, so that their order is kept.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <mutex>
#include <utility>
#include <vector>

#ifdef __APPLE__
#include <time.h>
#endif

#include "firmware/core/messages.hpp"
#include "hardware/descriptors.hpp"

namespace tensionlab {

constexpr double kMaxLengthJump = 0.05;        // m that a length may differ from the integral of the cable's speed
constexpr double kMaxAcceleration = 100.0;     // m/s2 of a cable
constexpr std::uint32_t kRestarted = 1000000;  // us: a module whose clock goes back further has restarted

// Finds frames in a stream of bytes, in pieces of any size. It works on whole pieces, unlike the firmware's
// parser.
class FrameDecoder {
 public:
  // Calls `found(frame)` for each frame that these bytes complete.
  template <class Found>
  void feed(const std::uint8_t* bytes, std::size_t size, Found&& found) {
    pending_.insert(pending_.end(), bytes, bytes + size);
    std::size_t begin = 0, at = 0;
    while (at + firmware::kDelimiter <= pending_.size()) {
      if (pending_[at] != 0 || pending_[at + 1] != 0 || pending_[at + 2] != 0) {
        ++at;
        continue;
      }
      decode(begin, at, found);
      begin = at += firmware::kDelimiter;
    }
    const std::size_t rest = skip_zeros(begin, pending_.size());
    pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(rest));
    // Of a piece that is too long only the last zeros matter, with which a delimiter may begin.
    if (pending_.size() > firmware::kMaxPiece + 2) {
      const std::uint8_t last[] = {pending_[pending_.size() - 2], pending_[pending_.size() - 1]};
      pending_.assign(firmware::kMaxPiece + 1, 1);
      pending_.insert(pending_.end(), last, last + 2);
    }
  }

  // Frames that were damaged, too long or too short.
  std::uint64_t bad_frames() const { return bad_frames_; }
  // Bytes of a frame that is not complete.
  std::size_t kept() const { return pending_.size(); }

 private:
  // Further zeros belong to the delimiter before.
  std::size_t skip_zeros(std::size_t begin, std::size_t end) const {
    while (begin < end && pending_[begin] == 0) ++begin;
    return begin;
  }

  template <class Found>
  void decode(std::size_t begin, std::size_t end, Found&& found) {
    begin = skip_zeros(begin, end);
    const std::size_t size = end - begin;
    if (size == 0) return;
    if (size <= firmware::kMaxPiece) {
      std::uint8_t piece[firmware::kMaxPiece];  // read_frame overwrites it
      firmware::Frame frame;
      std::memcpy(piece, pending_.data() + begin, size);
      if (firmware::read_frame(piece, size, frame)) {
        found(frame);
        return;
      }
    }
    ++bad_frames_;
  }

  std::vector<std::uint8_t> pending_;
  std::uint64_t bad_frames_ = 0;
};

struct Telemetry {
  static constexpr std::size_t kSize = 41;
  static constexpr std::uint8_t kMaxState = 5, kMaxLimit = 9, kMaxBrake = 4;

  std::uint8_t payload[kSize];
  std::uint32_t time_us;
  std::uint8_t state, limit, sequence, winding, brake;
  std::uint16_t faults;
  float tension, current, length, speed, supply, bearable;
  double received;  // s, by the clock of the link

  // Reads a payload; returns false if its length is wrong or a code unknown.
  bool read(const std::uint8_t* bytes, std::size_t size) {
    if (size != kSize) return false;
    std::copy(bytes, bytes + size, payload);
    firmware::Reader reader(bytes, size);
    time_us = reader.u32();
    state = reader.u8();
    faults = reader.u16();
    limit = reader.u8();
    sequence = reader.u8();
    for (float* number : {&tension, &current, &length, &speed, &supply, &bearable}) *number = reader.f32();
    winding = reader.u8();
    brake = reader.u8();
    return state <= kMaxState && limit <= kMaxLimit && brake <= kMaxBrake;
  }

  bool follows_set_points() const { return state == 1 || state == 2; }

  // Whether it can be true after what was reported before, if anything was.
  bool is_plausible(const Telemetry* before) const {
    for (const float number : {length, speed, tension, current, supply, bearable}) {
      if (!std::isfinite(number)) return false;
    }
    if (faults != 0) return false;
    if (before == nullptr) return true;
    // By the slower clock: that of a simulated module stops while its computer gives it no time.
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

  // Takes bytes received at a time in s; returns whether something is queued for Python now.
  bool feed(const std::uint8_t* bytes, std::size_t size, double now) {
    const std::lock_guard<std::mutex> locked(mutex_);
    decoder_.feed(bytes, size, [&](const firmware::Frame& frame) {
      Telemetry telemetry;
      if (queue_.empty() && !fields_.python_decodes &&
          frame.type == static_cast<std::uint8_t>(firmware::Type::telemetry) &&
          telemetry.read(frame.payload, frame.size)) {
        store(telemetry, now);
      } else {
        queue_.push_back(frame);
      }
    });
    return !queue_.empty();
  }

  // Takes the frames out of the queue.
  std::vector<firmware::Frame> take_queue() {
    const std::lock_guard<std::mutex> locked(mutex_);
    return std::exchange(queue_, {});
  }

  // Takes telemetry that was queued; returns whether it was newer than the latest.
  bool take(const Telemetry& telemetry, double now) {
    const std::lock_guard<std::mutex> locked(mutex_);
    return store(telemetry, now);
  }

  // The number of the next set-point: its sequence number, and above that the times those were used up since ARM.
  std::uint16_t next_set_point() {
    const std::lock_guard<std::mutex> locked(mutex_);
    return ++set_point_;
  }

  // The sequence number of the next ARM, from which on telemetry may report that set-points are followed.
  std::uint8_t next_arm() {
    const std::lock_guard<std::mutex> locked(mutex_);
    followed_ = false;
    return armed_ = static_cast<std::uint8_t>(set_point_ = (set_point_ + 1) & 0xFF);
  }

  // What Python reads and sets.
  struct Fields {
    int state = kNoState;
    std::uint16_t faults = 0, session = 0;
    bool python_decodes = false;      // Python gets all messages, telemetry too
    bool needs_attention = false;     // Python knows of a problem: a broken link, a refused set-point
    Descriptor file = kNoDescriptor;  // of the link, for set-points
  };

  // Sets a field. After the file was set to kNoDescriptor, the former one is not used any more.
  template <class T>
  void set(T Fields::* field, T value) {
    const std::lock_guard<std::mutex> locked(mutex_);
    fields_.*field = value;
  }

  struct Known {
    Telemetry latest, checked;
    std::uint64_t telemetries, checks;  // numbers of the latest, and of the one checked last; 0: none
    std::uint64_t stale, repeated, bad_frames;
    std::size_t kept;
    bool followed;
    Fields fields;
  };

  Known known() const {
    const std::lock_guard<std::mutex> locked(mutex_);
    return {latest_,         checked_,  telemetries_, checks_, stale_, repeated_, decoder_.bad_frames(),
            decoder_.kept(), followed_, fields_};
  }

  bool python_decodes() const {
    const std::lock_guard<std::mutex> locked(mutex_);
    return fields_.python_decodes;
  }

  // Counts the latest telemetry as checked.
  void set_checked() {
    const std::lock_guard<std::mutex> locked(mutex_);
    check();
  }
  // The next check ignores what was before.
  void clear_checked() {
    const std::lock_guard<std::mutex> locked(mutex_);
    checks_ = 0;
  }

  // Whether a module that should follow set-points certainly does, and its report can be true; Python looks into
  // what is not certain. By the link's clock in s; set-points live for `ttl`.
  bool is_well(double now, double ttl) {
    const std::lock_guard<std::mutex> locked(mutex_);
    const bool follows = fields_.state == 1 || fields_.state == 2;
    if (fields_.needs_attention || !follows || telemetries_ == 0 || !(now - latest_.received <= ttl)) return false;
    if (telemetries_ != checks_) {
      if (!latest_.is_plausible(checks_ == 0 ? nullptr : &checked_)) return false;
      check();
    }
    return true;
  }

  enum class Sent { yes, no_link, not_a_number, in_part, broken };

  // Sends SET_TENSION; returns its sequence number, or kNotSent.
  std::pair<std::int64_t, Sent> send_tension(double tension, bool brake, std::uint16_t ttl_ms, int& error) {
    const std::lock_guard<std::mutex> locked(mutex_);
    if (fields_.file == kNoDescriptor) return {kNotSent, Sent::no_link};
    const auto number = static_cast<float>(tension);
    if (!std::isfinite(number)) return {kNotSent, Sent::not_a_number};
    firmware::Frame frame;
    frame.type = static_cast<std::uint8_t>(firmware::Type::set_tension);
    frame.sequence = static_cast<std::uint8_t>(++set_point_);
    firmware::Writer writer(frame.payload);
    writer.u16(fields_.session);
    writer.f32(number);
    writer.u8(brake ? 1 : 0);
    writer.u16(ttl_ms);
    writer.u8(static_cast<std::uint8_t>(set_point_ >> 8));
    frame.size = static_cast<std::uint8_t>(writer.size());
    std::uint8_t bytes[firmware::kMaxFrame];
    const std::size_t size = firmware::write_frame(frame, bytes);
    const std::int64_t taken = write_now(fields_.file, bytes, size, error);
    if (taken < 0) return {kNotSent, Sent::broken};
    if (taken != static_cast<std::int64_t>(size)) return {kNotSent, Sent::in_part};
    return {frame.sequence, Sent::yes};
  }

 private:
  // Returns whether it is newer than the latest: sent after it, or by a module that has restarted since.
  bool store(const Telemetry& telemetry, double now) {
    if (telemetries_ > 0 && latest_.time_us - telemetry.time_us < kRestarted) {
      ++stale_;
      ++repeated_;
      return false;
    }
    repeated_ = 0;
    latest_ = telemetry;
    latest_.received = now;
    ++telemetries_;
    // The sequence number alone does not tell: an idle module repeats the last of an earlier session, or 0.
    const auto since = static_cast<std::uint8_t>(telemetry.sequence - armed_);
    if (telemetry.follows_set_points() && since <= static_cast<std::uint8_t>(set_point_ - armed_))
      followed_ = true;
    fields_.state = telemetry.state;
    fields_.faults = telemetry.faults;
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
  std::uint16_t set_point_;
  std::uint8_t armed_;
  bool followed_ = false;
  Fields fields_;
};

// The time in s by the clock of Python's time.perf_counter.
inline double seconds_now() {
#ifdef __APPLE__
  return 1e-9 * static_cast<double>(clock_gettime_nsec_np(CLOCK_UPTIME_RAW));
#else
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
#endif
}

// Waits for all links at once, and reads those that Python does not read itself.
class LinkReader {
 public:
  // Adds a file to those waited for. Its bytes go to the endpoint; if that is null, Python reads them.
  void add(Descriptor file, Endpoint* endpoint) {
    drop(file);
    polled_.push_back(polled_of(file));
    endpoints_.push_back(endpoint);
  }

  void drop(Descriptor file) {
    for (std::size_t i = 0; i < polled_.size(); ++i) {
      if (static_cast<Descriptor>(polled_[i].fd) != file) continue;
      polled_.erase(polled_.begin() + static_cast<std::ptrdiff_t>(i));
      endpoints_.erase(endpoints_.begin() + static_cast<std::ptrdiff_t>(i));
      return;
    }
  }

  // Reads until Python has something to do, and returns the files where: messages are queued, or Python must read
  // itself, which also tells it of an error or an end.
  std::vector<Descriptor> wait() {
    std::vector<Descriptor> for_python;
    while (for_python.empty()) {
      if (wait_for(polled_) <= 0) continue;
      for (std::size_t i = 0; i < polled_.size(); ++i) {
        if (polled_[i].revents != 0 && !read(i)) for_python.push_back(static_cast<Descriptor>(polled_[i].fd));
      }
    }
    return for_python;
  }

 private:
  static constexpr std::size_t kReadBytes = 4096;

  // Returns whether Python has nothing to do.
  bool read(std::size_t i) {
    Endpoint* const endpoint = endpoints_[i];
    if (polled_[i].revents != POLLIN || endpoint == nullptr || endpoint->python_decodes()) return false;
    std::uint8_t bytes[kReadBytes];
    const std::int64_t size = read_now(static_cast<Descriptor>(polled_[i].fd), bytes, sizeof bytes);
    return size > 0 && !endpoint->feed(bytes, static_cast<std::size_t>(size), seconds_now());
  }

  std::vector<Polled> polled_;
  std::vector<Endpoint*> endpoints_;
};

}  // namespace tensionlab
