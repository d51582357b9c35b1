// The rows of a batch, shared among threads.
#pragma once

#include <cstddef>
#include <functional>

namespace tensionlab {

// Calls work(begin, end) over [0, size) without the interpreter's lock, on threads if each has enough rows to pay
// for its wake-up, some 0.1 ms. An exception on any thread, or of Python's signal handler, is rethrown here once
// all threads have stopped.
void share_out(std::size_t size, const std::function<void(std::size_t, std::size_t)>& work,
               std::size_t rows_enough = 1024);

// Remembers the calling process's main Python thread, where signals are handled.
void find_main_thread();

}  // namespace tensionlab
