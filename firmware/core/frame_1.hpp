// What is left of protocol 1: a module answers its HELLO, so that an older host learns whom it talks to.
#pragma once

#include "messages.hpp"

namespace tensionlab {
namespace firmware {

constexpr size_t kHello1 = 2 + 2 + 1;                         // HELLO in protocol 1, without its zero
constexpr size_t kMaxFrame1 = kMaxBody + 2 + 1 + kDelimiter;  // one of protocol 1, with the zeros of this one

// The frame in protocol 1: COBS( type, sequence number, payload, CRC-16 ). It ended with one zero; more do no
// harm.
inline size_t write_frame_1(const Frame& frame, uint8_t* out) {
  uint8_t body[kMaxBody + 2];
  Writer writer(body);
  writer.u8(frame.type);
  writer.u8(frame.sequence);
  writer.raw(frame.payload, frame.size);
  writer.u16(crc16(body, writer.size()));
  return write_delimiter(out, cobs_encode(body, writer.size(), out));
}

// Whether these bytes before a zero are HELLO in protocol 1.
inline bool read_hello_1(const uint8_t* piece, size_t size, Frame& frame) {
  if (size != kHello1) return false;
  uint8_t body[kHello1];
  memcpy(body, piece, kHello1);
  if (cobs_decode(body, kHello1) != 4) return false;
  Reader crc(body + 2, 2);
  if (body[0] != static_cast<uint8_t>(Type::hello) || crc.u16() != crc16(body, 2)) return false;
  frame.type = body[0];
  frame.sequence = body[1];
  frame.size = 0;
  return true;
}

}  // namespace firmware
}  // namespace tensionlab
