// The watchdog for Python.
#include "hardware/watchdog.hpp"

#include <nanobind/stl/string.h>

#include "bindings/bindings.hpp"

namespace tensionlab {

namespace nb = nanobind;

void bind_watchdog(nb::module_& module) {
  nb::class_<Watchdog>(module, "Watchdog")
      .def(nb::init<std::string>())
      .def("kick", &Watchdog::kick)
      .def("close", &Watchdog::close);
}

}  // namespace tensionlab
