// The Python module tensionlab._native: arrays in, arrays out. Each function is called by the one Python module
// that owns its subject.
#include <nanobind/stl/string.h>

#include <string>

#include "batch.hpp"
#include "bindings.hpp"
#include "instruction_set.hpp"

NB_MODULE(_native, module) {
  using namespace tensionlab;
  module.attr("MAX_COMPONENTS") = kMaxComponents;
  module.attr("MAX_CABLES") = kMaxCables;
  module.def("instruction_set", [] { return std::string(instruction_set_name()); });
  bind_allocate(module);
  bind_brakes(module);
  bind_clearance(module);
  bind_closed_form(module);
  bind_dykstra(module);
  bind_equilibrium(module);
  bind_firmware(module);
  bind_judge(module);
  bind_linear_program(module);
  bind_newton(module);
  bind_pose_tracker(module);
  bind_smooth(module);
  bind_watchdog(module);
  bind_workspace(module);
}
