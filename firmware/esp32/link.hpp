// The link to the host: Bluetooth Classic (SPP) while somebody is connected there, else USB. The other one is
// read, too: whoever sends a stop there is obeyed.
//
// Two tasks on the first processor: one reads, one writes. Writing to Bluetooth may block for a second, and an
// emergency stop must be read meanwhile. The FOC task on the other processor touches only the queues.
#pragma once

#include <stdint.h>

#include "byte_queue.hpp"

namespace tensionlab {
namespace firmware {

class Link {
 public:
  // serial_number ends the name under which the module is found: tensionlab-1a2b3c4d.
  bool begin(uint32_t serial_number);

  // For the FOC task; none of these waits.
  size_t receive(uint8_t* bytes, size_t most) { return received_.take(bytes, most); }
  // What came over the link that is not in use.
  size_t overhear(uint8_t* bytes, size_t most) { return overheard_.take(bytes, most); }
  // Whether strangers may pair: storing their keys halts the loop for some ms, so only while nothing pulls.
  void allow_pairing(bool allowed) { may_pair_.store(allowed, std::memory_order_relaxed); }
  size_t room() const { return to_send_.room(); }
  void send(const uint8_t* bytes, size_t size) { to_send_.put(bytes, size); }
  // Whether the host went away, or another took the link, since this was last asked. Ask after receive(): what
  // a new host sent is then never taken for what came before it.
  bool take_closed() { return closed_.exchange(false, std::memory_order_acq_rel); }

 private:
  static void read_forever(void* self);
  static void write_forever(void* self);
  void read();
  void write();
  void watch_button();

  ByteQueue<1024> received_, to_send_;
  ByteQueue<256> overheard_;
  std::atomic<bool> closed_{false}, bluetooth_{false}, may_pair_{false};
  bool pairing_ = false;
  uint32_t pairing_us_ = 0;  // since when
};

}  // namespace firmware
}  // namespace tensionlab
