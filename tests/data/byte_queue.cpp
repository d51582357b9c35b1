// Two threads, one queue: prints how many bytes came, and how many of them wrong.
#include "byte_queue.hpp"

#include <cstdio>
#include <thread>

using tensionlab::firmware::ByteQueue;

namespace {

// What byte comes at a place, and how many are moved at a time: both look random, and are the same on both sides.
uint8_t byte_at(size_t place) { return static_cast<uint8_t>((place * 2654435761u) >> 13); }
size_t piece_after(size_t place) { return 1 + (place * 40503u >> 7) % 97; }

}  // namespace

int main() {
  constexpr size_t kBytes = 200000;
  static ByteQueue<64> queue;
  std::thread writer([] {
    for (size_t sent = 0; sent < kBytes;) {
      uint8_t bytes[97];
      const size_t wanted = piece_after(sent), size = wanted < kBytes - sent ? wanted : kBytes - sent;
      for (size_t i = 0; i < size; ++i) bytes[i] = byte_at(sent + i);
      const size_t taken = queue.put(bytes, size);
      if (taken == 0) std::this_thread::yield();
      sent += taken;
    }
  });
  size_t wrong = 0, came = 0, most = 0;
  while (came < kBytes) {
    uint8_t bytes[97];
    const size_t size = queue.take(bytes, piece_after(came + 1));
    for (size_t i = 0; i < size; ++i) wrong += bytes[i] != byte_at(came + i);
    most = size > most ? size : most;
    if (size == 0) std::this_thread::yield();
    came += size;
  }
  writer.join();
  uint8_t rest;
  std::printf("%zu %zu %zu %zu %zu\n", came, wrong, most, queue.take(&rest, 1), queue.room());
}
