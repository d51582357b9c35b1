// Ends the process when Python is blocked: a native call holds the interpreter's lock and does not return.
//
// A thread counts ticks down without that lock. It counts ticks and not time: a process that was stopped, or got
// no time on a busy machine, has not missed any.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

namespace tensionlab {

class Watchdog {
 public:
  // message: written to stderr when time is up, before the exit with status 1. It counts from the first kick on.
  explicit Watchdog(std::string message) : message_(std::move(message)), thread_([this] { watch(); }) {}
  ~Watchdog() { close(); }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  // Restarts the countdown: the next kick must come within this time in s.
  void kick(double seconds) { ticks_left_ = static_cast<long>(seconds / kTickSeconds) + 1; }

  void close() {
    {
      const std::lock_guard<std::mutex> locked(mutex_);
      closed_ = true;
    }
    closing_.notify_all();
    if (thread_.joinable()) thread_.join();
  }

 private:
  static constexpr double kTickSeconds = 0.02;
  static constexpr long kNever = -1;

  void watch() {
    std::unique_lock<std::mutex> locked(mutex_);
    while (!closing_.wait_for(locked, std::chrono::duration<double>(kTickSeconds), [this] { return closed_; })) {
      long left = ticks_left_;
      if (left == kNever) continue;
      if (left == 0) {
        std::fputs(message_.c_str(), stderr);
        std::fflush(stderr);
        std::_Exit(1);
      }
      ticks_left_.compare_exchange_strong(left, left - 1);
    }
  }

  const std::string message_;
  std::atomic<long> ticks_left_{kNever};
  bool closed_ = false;
  std::mutex mutex_;
  std::condition_variable closing_;
  std::thread thread_;  // the last member: it uses all others
};

}  // namespace tensionlab
