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

// Takes a frame of protocol 1 from what was before a zero, which it overwrites; false if it is damaged, or none.
inline bool read_frame_1(uint8_t* piece, size_t size, Frame& frame) {
  const size_t body = cobs_decode(piece, size);
  if (body < 4 || body > kMaxBody + 2) return false;
  Reader crc(piece + body - 2, 2);
  if (crc.u16() != crc16(piece, body - 2)) return false;
  frame.type = piece[0];
  frame.sequence = piece[1];
  frame.size = static_cast<uint8_t>(body - 4);
  memcpy(frame.payload, piece + 2, frame.size);
  return true;
}

// Whether these bytes before a zero are HELLO in protocol 1.
inline bool read_hello_1(const uint8_t* piece, size_t size, Frame& frame) {
  if (size != kHello1) return false;
  uint8_t copy[kHello1];
  memcpy(copy, piece, kHello1);
  return read_frame_1(copy, kHello1, frame) && frame.type == static_cast<uint8_t>(Type::hello);
}

}  // namespace firmware
}  // namespace tensionlab
