// The Python module tensionlab._native: arrays in, arrays out.
#include <stdexcept>

#include "bindings/bindings.hpp"
#include "simd/instruction_set.hpp"
#include "tensionlab/simd/batch.hpp"

NB_MODULE(_native, module) {
  using namespace tensionlab;
  nanobind::set_leak_warnings(false);  // threads hold links that were not closed until the process ends
  find_main_thread();
  module.attr("MAX_COMPONENTS") = kMaxComponents;
  module.attr("MAX_CABLES") = kMaxCables;
  if (instruction_set() == InstructionSet::none) {
    throw std::runtime_error(
        "tensionlab was compiled for instruction sets that this processor lacks; build it here, or with "
        "TENSIONLAB_BUILDS=all");
  }
  module.attr("INSTRUCTION_SET") = kInstructionSetNames[static_cast<int>(instruction_set())];
  nanobind::list compiled;
  for (int set = 0; set < kInstructionSets; ++set) {
    if (kCompiled[set]) compiled.append(kInstructionSetNames[set]);
  }
  module.attr("INSTRUCTION_SETS") = nanobind::tuple(compiled);
  module.attr("COMPILER") = TENSIONLAB_COMPILER;
  bind_allocate(module);
  bind_control_loop(module);
  bind_endpoints(module);
  bind_firmware(module);
  bind_jacobian(module);
  bind_single_calls(module);
  bind_solvers(module);
  bind_workspace(module);
}
