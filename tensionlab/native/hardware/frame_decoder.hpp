// Frames in a stream of bytes, however it is cut into pieces, as the host reads them.
//
// Unlike the firmware's parser it goes by whole pieces.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "firmware/core/frame.hpp"

namespace tensionlab {

class FrameDecoder {
 public:
  // Calls `found(frame)` for each frame that these bytes complete.
  template <class Found>
  void feed(const std::uint8_t* bytes, std::size_t size, Found&& found) {
    rest_.insert(rest_.end(), bytes, bytes + size);
    std::size_t begin = 0, at = 0;
    while (at + firmware::kDelimiter <= rest_.size()) {
      if (rest_[at] != 0 || rest_[at + 1] != 0 || rest_[at + 2] != 0) {
        ++at;
        continue;
      }
      take(begin, at, found);
      begin = at += firmware::kDelimiter;
    }
    rest_.erase(rest_.begin(), rest_.begin() + static_cast<std::ptrdiff_t>(after_zeros(begin, rest_.size())));
    // Of what is too long already only its last zeros matter, with which a delimiter may begin.
    if (rest_.size() > firmware::kMaxPiece + 2) {
      const std::uint8_t last[] = {rest_[rest_.size() - 2], rest_[rest_.size() - 1]};
      rest_.assign(firmware::kMaxPiece + 1, 1);
      rest_.insert(rest_.end(), last, last + 2);
    }
  }

  // Those that were damaged, too long or too short.
  std::uint64_t bad_frames() const { return bad_frames_; }
  // Bytes that wait for what completes them.
  std::size_t kept() const { return rest_.size(); }

 private:
  // More zeros than three belong to the delimiter before.
  std::size_t after_zeros(std::size_t begin, std::size_t end) const {
    while (begin < end && rest_[begin] == 0) ++begin;
    return begin;
  }

  template <class Found>
  void take(std::size_t begin, std::size_t end, Found&& found) {
    begin = after_zeros(begin, end);
    const std::size_t size = end - begin;
    if (size == 0) return;
    if (size <= firmware::kMaxPiece) {
      std::uint8_t piece[firmware::kMaxPiece];  // reading overwrites it
      firmware::Frame frame;
      std::memcpy(piece, rest_.data() + begin, size);
      if (firmware::read_frame(piece, size, frame)) {
        found(frame);
        return;
      }
    }
    ++bad_frames_;
  }

  std::vector<std::uint8_t> rest_;
  std::uint64_t bad_frames_ = 0;
};

}  // namespace tensionlab
