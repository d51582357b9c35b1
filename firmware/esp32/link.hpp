// The link to the host: Bluetooth Classic (SPP) while somebody is connected there, else USB.
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

  ByteQueue<1024> received_, to_send_;
  std::atomic<bool> closed_{false}, bluetooth_{false};
};

}  // namespace firmware
}  // namespace tensionlab
