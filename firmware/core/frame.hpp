// A frame: COBS( type, sequence number, payload, CRC-16 ) and a zero byte. Bytes to frames and back.
#pragma once

#include "bytes.hpp"
#include "cobs.hpp"
#include "crc16.hpp"

namespace tensionlab {
namespace firmware {

constexpr size_t kMaxPayload = 56;
constexpr size_t kMaxBody = 2 + kMaxPayload + 2;  // before stuffing
constexpr size_t kMaxFrame = kMaxBody + 2;        // on the wire, the zero byte included

struct Frame {
  uint8_t type;
  uint8_t sequence;
  uint8_t size;
  uint8_t payload[kMaxPayload];
};

// The frame on the wire; `out` needs kMaxFrame bytes. Returns how many it has.
inline size_t write_frame(const Frame& frame, uint8_t* out) {
  uint8_t body[kMaxBody];
  Writer writer(body);
  writer.u8(frame.type);
  writer.u8(frame.sequence);
  writer.raw(frame.payload, frame.size);
  writer.u16(crc16(body, writer.size()));
  const size_t size = cobs_encode(body, writer.size(), out);
  out[size] = 0;
  return size + 1;
}

// Picks frames out of a stream of bytes. Whatever is damaged, too long or too short is counted and left out, and
// the next zero byte starts afresh.
class FrameParser {
 public:
  // Whether this byte completed a good frame.
  bool take(uint8_t byte, Frame& frame) {
    if (byte != 0) {
      if (size_ < sizeof buffer_) buffer_[size_] = byte;
      if (size_ <= sizeof buffer_) ++size_;  // one beyond: too long, whatever follows
      return false;
    }
    const size_t size = size_;
    size_ = 0;
    if (size == 0) return false;  // zero bytes may be sent to start afresh
    if (size <= sizeof buffer_ && read(size, frame)) return true;
    if (bad_frames_ != 0xFFFF) ++bad_frames_;
    return false;
  }

  // The rest of a frame will not come any more.
  void restart() { size_ = 0; }

  uint16_t bad_frames() const { return bad_frames_; }

 private:
  bool read(size_t size, Frame& frame) {
    const size_t body = cobs_decode(buffer_, size);
    if (body < 4 || body > kMaxBody) return false;
    Reader crc(buffer_ + body - 2, 2);
    if (crc.u16() != crc16(buffer_, body - 2)) return false;
    frame.type = buffer_[0];
    frame.sequence = buffer_[1];
    frame.size = static_cast<uint8_t>(body - 4);
    memcpy(frame.payload, buffer_ + 2, frame.size);
    return true;
  }

  uint8_t buffer_[kMaxFrame - 1];
  size_t size_ = 0;
  uint16_t bad_frames_ = 0;
};

}  // namespace firmware
}  // namespace tensionlab
