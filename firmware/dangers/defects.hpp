// Single defects of a module, for whoever looks for them.
#pragma once

#include "story.hpp"

namespace tensionlab {
namespace dangers {

struct Defect {
  const char* name;
  void (*before)(Story&);  // the module boots
  void (*after)(Story&);   // it has booted, and has its settings
};

extern const Defect kDefects[];
extern const int kDefectCount;

}  // namespace dangers
}  // namespace tensionlab
