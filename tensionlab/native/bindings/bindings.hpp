// Each family of kernels binds its own functions to the Python module tensionlab._native.
#pragma once

#include <nanobind/nanobind.h>

#include "firmware/core/frame.hpp"

namespace tensionlab {

// A frame as type, sequence number and payload.
nanobind::tuple tuple_of(const firmware::Frame&);

void bind_allocate(nanobind::module_&);
void bind_control_loop(nanobind::module_&);
void bind_endpoints(nanobind::module_&);
void bind_firmware(nanobind::module_&);
void bind_jacobian(nanobind::module_&);
void bind_solvers(nanobind::module_&);
void bind_workspace(nanobind::module_&);

}  // namespace tensionlab
