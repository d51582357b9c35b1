// The tasks of the firmware on threads of this computer: one runs at a time, and the one that wakes first is next,
// so that the same bytes always have the same effects. Time is that of the task that runs, and passes only in
// sleep().
#pragma once

#include <cstdint>
#include <functional>

namespace tensionlab {
namespace fakes {

std::uint64_t now_us();
void sleep_us(std::uint64_t duration);
void start_task(const std::function<void()>& task);  // which never returns

}  // namespace fakes
}  // namespace tensionlab
