// One module that allocates for all: from a wrench to the set-point of each link.
//
// The front end gives it the structure matrix at the pose, and the wrench; it writes a SET_TENSION for each
// module, which the front end sends over that module's link. A module that hears nothing lets go after the time to
// live, as with any other host. float, no heap, no exceptions: it reads no clock and touches no pin.
#pragma once

#include "firmware/core/frame.hpp"
#include "firmware/core/messages.hpp"
#include "tensionlab/allocate.hpp"

namespace tensionlab {
namespace firmware {

template <int N, int M>
class CoordinatorModule {
 public:
  using Answer = Allocation<float, N, M>;

  // Limits (M) in N. session: the one that every module was armed with. iteration_limit: bounds the time of a
  // call; at the bound, the tensions are still inside the limits.
  CoordinatorModule(const float* lower, const float* upper, uint16_t session, uint16_t ttl_ms, int iteration_limit)
      : allocator_(lower, upper), session_(session), ttl_ms_(ttl_ms) {
    allocator_.iteration_limit = iteration_limit;
  }

  Allocator<float, N, M>& allocator() { return allocator_; }

  // structure: N x M, row by row. frames, sizes: for the link of each module.
  const Answer& command(const float* structure, const float* wrench, uint8_t (&frames)[M][kMaxFrame],
                        size_t (&sizes)[M]) {
    const Answer& answer = allocator_(structure, wrench);
    for (int i = 0; i < M; ++i) sizes[i] = write_set_point(answer.tensions[i], frames[i]);
    if (++sequence_ == 0) ++rounds_;
    return answer;
  }

 private:
  size_t write_set_point(float tension, uint8_t* out) const {
    Frame frame;
    Writer writer(frame.payload);
    writer.u16(session_);
    writer.f32(tension);
    writer.u8(0);  // no brake
    writer.u16(ttl_ms_);
    writer.u8(rounds_);
    frame.type = static_cast<uint8_t>(Type::set_tension);
    frame.sequence = sequence_;
    frame.size = static_cast<uint8_t>(writer.size());
    return write_frame(frame, out);
  }

  Allocator<float, N, M> allocator_;
  uint16_t session_, ttl_ms_;
  uint8_t sequence_ = 1, rounds_ = 0;  // 0 was the sequence number of ARM
};

}  // namespace firmware
}  // namespace tensionlab
