// Picks frames out of a stream of bytes.
#pragma once

#include "messages.hpp"

namespace tensionlab {
namespace firmware {

// Whatever is damaged, too long or too short is counted and left out, and the next three zeros start afresh.
class FrameParser {
 public:
  // Whether this byte completes a frame.
  bool take(uint8_t byte, Frame& frame) {
    if (byte != 0) {
      if (zeros_ != 0) {
        damaged_ = zeros_ < kDelimiter;  // no frame has a zero in it
        size_ = 0;
        zeros_ = 0;
      }
      if (size_ < sizeof piece_) piece_[size_++] = byte;
      return false;
    }
    if (zeros_ == kDelimiter) return false;  // more zeros do no harm
    ++zeros_;
    if (zeros_ < kDelimiter || (size_ == 0 && !damaged_)) return false;
    const bool whole = !damaged_ && read_frame(piece_, size_, frame);
    if (!whole && bad_frames_ != 0xFFFF) ++bad_frames_;
    size_ = 0;
    damaged_ = false;
    return whole;
  }

  // The rest of a frame will not come any more.
  void restart() {
    size_ = 0;
    zeros_ = kDelimiter;
    damaged_ = false;
  }

  uint16_t bad_frames() const { return bad_frames_; }

 private:
  uint8_t piece_[kMaxPiece + 1];  // one beyond: too long, whatever follows
  size_t size_ = 0;               // bytes since the last zero
  size_t zeros_ = kDelimiter;     // in a row, up to now
  bool damaged_ = false;          // since the last delimiter there was a zero that ended nothing
  uint16_t bad_frames_ = 0;
};

}  // namespace firmware
}  // namespace tensionlab
