// What the bindings share: each family of kernels binds its own functions to the Python module tensionlab._native.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <functional>

#include "firmware/core/frame.hpp"

namespace tensionlab {

// Calls work(begin, end) over [0, size) without the interpreter's lock, on threads if each has enough rows to pay
// for its wake-up, some 0.1 ms. An exception on any thread, or of Python's signal handler, is rethrown here once
// all threads have stopped.
void share_out(std::size_t size, const std::function<void(std::size_t, std::size_t)>& work,
               std::size_t rows_enough = 1024);

// Remembers the calling process's main Python thread, where signals are handled.
void find_main_thread();

// A frame as type, sequence number and payload.
nanobind::tuple tuple_of(const firmware::Frame&);

void bind_allocate(nanobind::module_&);
void bind_control_loop(nanobind::module_&);
void bind_endpoints(nanobind::module_&);
void bind_firmware(nanobind::module_&);
void bind_jacobian(nanobind::module_&);
void bind_single_calls(nanobind::module_&);
void bind_solvers(nanobind::module_&);
void bind_workspace(nanobind::module_&);

}  // namespace tensionlab
