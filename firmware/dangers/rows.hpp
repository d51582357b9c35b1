// The dangers, each with what must happen and within which bounds.
#pragma once

#include "story.hpp"

namespace tensionlab {
namespace dangers {

enum class Outcome {
  let_go,     // the driver goes off within the time
  times_out,  // it pulls with the minimum tension within the time, and lets go 2 s later
  refused,    // it does not arm or align: its driver does not pull
  reports,    // it says so within the time, and pulls what it is told
  goes_on,    // nothing is noticed, or nothing is wrong: it pulls what it is told
};

struct Row {
  const char* fault;    // what is wrong, or goes wrong
  const char* happens;  // what must happen
  Outcome outcome;
  std::uint16_t faults;  // bits of which the module must name one; 0: none
  double within_s;       // the latest that it is noticed
  double most_n;         // the largest tension from then on
  void (*play)(Story&);
  double least_n = 0.0;        // the least, where it goes on
  const char* says = nullptr;  // what a line of text from the module must hold
};

extern const Row kRows[];
extern const int kRowCount;

}  // namespace dangers
}  // namespace tensionlab
