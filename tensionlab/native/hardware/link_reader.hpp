// Waits for all links at once, and reads those that Python does not read itself.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#ifdef __APPLE__
#include <time.h>
#endif

#include "hardware/descriptors.hpp"
#include "hardware/endpoint.hpp"

namespace tensionlab {

// The time in s by the clock of Python's time.perf_counter.
inline double seconds_now() {
#ifdef __APPLE__
  return 1e-9 * static_cast<double>(clock_gettime_nsec_np(CLOCK_UPTIME_RAW));
#else
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
#endif
}

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
