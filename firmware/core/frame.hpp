// A frame: COBS( type, sequence number, payload ), its CRC-16, and three zeros. Bytes to frames and back.
//
// Any one or two flipped bits of a stream are found, whatever the frames hold; PROTOCOL.md has the argument.
#pragma once

#include "bytes.hpp"
#include "cobs.hpp"
#include "crc16.hpp"

namespace tensionlab {
namespace firmware {

constexpr size_t kMaxPayload = 56;
constexpr size_t kMaxBody = 2 + kMaxPayload;  // before stuffing
constexpr size_t kChecksum = 3, kDelimiter = 3;
constexpr size_t kMinPiece = 2 + 1 + kChecksum;         // what lies between two delimiters, without a payload,
constexpr size_t kMaxPiece = kMaxBody + 1 + kChecksum;  // and with the longest
constexpr size_t kMaxFrame = kMaxPiece + kDelimiter;    // on the wire

// Set in the first byte, so that it takes three flips to make it a zero. COBS leaves these bits free there.
constexpr uint8_t kFirst = 0xC0;
static_assert(kMaxBody + 1 < 0x40, "the first byte of COBS has two bits to spare");

struct Frame {
  uint8_t type;
  uint8_t sequence;
  uint8_t size;
  uint8_t payload[kMaxPayload];
};

// The CRC-16 of stuffed bytes in 7, 7 and 2 bits. All other bits are set: no byte is zero, nor the last nearly so.
inline void write_checksum(const uint8_t* stuffed, size_t size, uint8_t* out) {
  const uint16_t crc = crc16(stuffed, size);
  out[0] = static_cast<uint8_t>(0x80 | (crc >> 9));
  out[1] = static_cast<uint8_t>(0x80 | ((crc >> 2) & 0x7F));
  out[2] = static_cast<uint8_t>(0xFC | (crc & 0x03));
}

// Ends what lies in `out`. Returns how many bytes it has then.
inline size_t write_delimiter(uint8_t* out, size_t size) {
  for (size_t i = 0; i < kDelimiter; ++i) out[size++] = 0;
  return size;
}

// The frame on the wire; `out` needs kMaxFrame bytes. Returns how many it has.
inline size_t write_frame(const Frame& frame, uint8_t* out) {
  uint8_t body[kMaxBody];
  Writer writer(body);
  writer.u8(frame.type);
  writer.u8(frame.sequence);
  writer.raw(frame.payload, frame.size);
  const size_t size = cobs_encode(body, writer.size(), out);
  out[0] |= kFirst;
  write_checksum(out, size, out + size);
  return write_delimiter(out, size + kChecksum);
}

// Takes a frame from what was between two delimiters, which it overwrites; false if it is damaged.
inline bool read_frame(uint8_t* piece, size_t size, Frame& frame) {
  if (size < kMinPiece || size > kMaxPiece || (piece[0] & kFirst) != kFirst) return false;
  const size_t stuffed = size - kChecksum;
  uint8_t checksum[kChecksum];
  write_checksum(piece, stuffed, checksum);
  for (size_t i = 0; i < kChecksum; ++i) {
    if (piece[stuffed + i] != checksum[i]) return false;
  }
  piece[0] ^= kFirst;
  const size_t body = cobs_decode(piece, stuffed);
  if (body < 2) return false;
  frame.type = piece[0];
  frame.sequence = piece[1];
  frame.size = static_cast<uint8_t>(body - 2);
  memcpy(frame.payload, piece + 2, frame.size);
  return true;
}

}  // namespace firmware
}  // namespace tensionlab
