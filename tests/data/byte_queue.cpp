// Two threads, one queue: prints how many bytes were sent and came, and how many of them wrong.
#include "byte_queue.hpp"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

using tensionlab::firmware::ByteQueue;

namespace {

// What byte comes at a place, and how many are moved at a time: both look random, and are the same on both sides.
uint8_t byte_at(size_t place) { return static_cast<uint8_t>((place * 2654435761u) >> 13); }
size_t piece_after(size_t place) { return 1 + (place * 40503u >> 7) % 97; }

}  // namespace

int main() {
  // On a busy machine each of the two waits for its turn: then as many as come in ten seconds.
  constexpr size_t kBytes = 8000000;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  static ByteQueue<64> queue;
  std::atomic<bool> ended{false};
  size_t sent = 0;
  std::thread writer([&] {
    while (sent < kBytes) {
      uint8_t bytes[97];
      const size_t wanted = piece_after(sent), size = wanted < kBytes - sent ? wanted : kBytes - sent;
      for (size_t i = 0; i < size; ++i) bytes[i] = byte_at(sent + i);
      const size_t taken = queue.put(bytes, size);
      sent += taken;
      if (taken != 0) continue;
      if (std::chrono::steady_clock::now() > end) break;
      std::this_thread::yield();
    }
    ended = true;
  });
  size_t wrong = 0, came = 0, most = 0;
  for (;;) {
    const bool last = ended;
    uint8_t bytes[97];
    const size_t size = queue.take(bytes, piece_after(came + 1));
    for (size_t i = 0; i < size; ++i) wrong += bytes[i] != byte_at(came + i);
    most = size > most ? size : most;
    came += size;
    if (size != 0) continue;
    if (last) break;
    std::this_thread::yield();
  }
  writer.join();
  uint8_t rest;
  std::printf("%zu %zu %zu %zu %zu %zu\n", sent, came, wrong, most, queue.take(&rest, 1), queue.room());
}
