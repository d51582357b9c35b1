// The rows of a batch, shared out among threads.
#pragma once

#include <cstddef>
#include <functional>

namespace tensionlab {

// work(begin, end) over [0, size) without the interpreter's lock, on threads when each has enough rows to pay for
// being woken, which takes some 0.1 ms. What the work throws on any thread is thrown here once all threads have
// stopped, and so is what Python's handler of a signal raises.
void share_out(std::size_t size, const std::function<void(std::size_t, std::size_t)>& work,
               std::size_t rows_enough = 1024);

// Remembers which thread is Python's main one: signals are handled there.
void find_main_thread();

}  // namespace tensionlab
