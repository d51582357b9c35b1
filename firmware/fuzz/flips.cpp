// Does a frame pass with one or two bits flipped? Every such flip of frames of every length, between two others,
// from the delimiter before it to its own.
//
//   flips CONTENTS SEED    so many contents for each length of payload; the first are made to be difficult
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>

#include "../core/parser.hpp"

using namespace tensionlab::firmware;

namespace {

constexpr size_t kMost = 3 * kMaxFrame;

Frame frame_of(uint8_t type, size_t size) {
  Frame frame = {type, 7, static_cast<uint8_t>(size), {}};
  return frame;
}

bool same(const Frame& one, const Frame& other) {
  return one.type == other.type && one.sequence == other.sequence && one.size == other.size &&
         memcmp(one.payload, other.payload, one.size) == 0;
}

// What becomes of one frame under all flips.
class Trial {
 public:
  explicit Trial(const Frame& frame) {
    size_ = write_frame(before_, stream_);
    begin_ = size_ - kDelimiter;
    size_ += write_frame(frame, stream_ + size_);
    end_ = size_;
    size_ += write_frame(after_, stream_ + size_);
    if (found() != 3) std::abort();  // whole, all three are read
  }

  // Calls for every one and every two bits: how many flips there were, and after how many a frame passed.
  void run(unsigned long long& flips, unsigned long long& passed) {
    for (size_t one = 8 * begin_; one < 8 * end_; ++one) {
      flip(one);
      for (size_t other = one; other < 8 * end_; ++other) {
        if (other != one) flip(other);
        ++flips;
        if (damage_passes()) ++passed;
        if (other != one) flip(other);
      }
      flip(one);
    }
  }

 private:
  void flip(size_t bit) { stream_[bit / 8] = static_cast<uint8_t>(stream_[bit / 8] ^ (1u << (bit % 8))); }

  int found() {
    FrameParser parser;
    Frame frame;
    int count = 0;
    for (size_t i = 0; i < size_; ++i) {
      if (parser.take(stream_[i], frame)) ++count;
    }
    return count;
  }

  // Whether anything is read that is neither of the two whole frames.
  bool damage_passes() {
    FrameParser parser;
    Frame frame;
    for (size_t i = 0; i < size_; ++i) {
      if (!parser.take(stream_[i], frame)) continue;
      if (!same(frame, before_) && !same(frame, after_)) return true;
    }
    return false;
  }

  const Frame before_ = frame_of(0x8C, 0), after_ = frame_of(0x8D, 0);
  uint8_t stream_[kMost];
  size_t size_, begin_, end_;
};

// Where bits flip to zeros easily, where stuffing is dense, and where a whole frame lies within the payload.
void fill(Frame& frame, unsigned kind, std::mt19937_64& random) {
  uint8_t inner[kMaxFrame];
  const size_t inside = write_frame(frame_of(0x06, 0), inner) - kDelimiter;
  for (size_t i = 0; i < frame.size; ++i) {
    const uint8_t any = static_cast<uint8_t>(random());
    const uint8_t bit = static_cast<uint8_t>(1u << (any % 8));
    const size_t turn = i % (inside + 1);
    const uint8_t nested = turn == inside ? 0x10 : inner[turn];
    const uint8_t choices[] = {0, 0xFF, 1, bit, static_cast<uint8_t>(i % 2 != 0 ? bit : 0), nested, any};
    frame.payload[i] = kind < 7 ? choices[kind] : (any < 85 ? 0 : (any < 128 ? bit : any));
  }
}

unsigned long long all(unsigned contents, unsigned long seed) {
  std::mt19937_64 random(seed);
  unsigned long long flips = 0, passed = 0;
  for (unsigned kind = 0; kind < contents; ++kind) {
    for (size_t size = 0; size <= kMaxPayload; ++size) {
      Frame frame = frame_of(static_cast<uint8_t>(kind < 7 ? 0x03 : random()), size);
      frame.sequence = static_cast<uint8_t>(random());
      fill(frame, kind, random);
      Trial(frame).run(flips, passed);
    }
  }
  std::printf("%llu flips, %llu passed\n", flips, passed);
  return passed;
}

}  // namespace

int main(int count, char** words) {
  if (count != 3) {
    std::fprintf(stderr, "usage: flips CONTENTS SEED\n");
    return 2;
  }
  const unsigned contents = static_cast<unsigned>(std::strtoul(words[1], nullptr, 10));
  const unsigned long seed = std::strtoul(words[2], nullptr, 10);
  return all(contents, seed) == 0 ? 0 : 1;
}
