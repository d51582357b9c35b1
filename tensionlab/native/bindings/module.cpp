// The Python module tensionlab._native: arrays in, arrays out. Each function is called by the one Python module
// that owns its subject.
#include <nanobind/stl/string.h>

#include <string>

#include "bindings/bindings.hpp"
#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"

NB_MODULE(_native, module) {
  using namespace tensionlab;
  module.attr("MAX_COMPONENTS") = kMaxComponents;
  module.attr("MAX_CABLES") = kMaxCables;
  module.def("instruction_set", [] { return std::string(instruction_set_name()); });
  bind_allocate(module);
  bind_brakes(module);
  bind_clearance(module);
  bind_firmware(module);
  bind_verification(module);
  bind_pose_tracker(module);
  bind_solvers(module);
  bind_watchdog(module);
  bind_workspace(module);
}
