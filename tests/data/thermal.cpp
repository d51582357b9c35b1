// thermal: the firmware's budget of a winding that carries a current (A) for some steps of 10 ms, by argument.
// Printed are, after each of them, the current (A) that it stands, and the spent share of the budget.
#include "core/thermal.hpp"

#include <cstdio>
#include <cstdlib>

int main(int count, char** words) {
  if (count != 3) return 2;
  const tensionlab::firmware::Parameters parameters;
  tensionlab::firmware::ThermalBudget budget;
  for (int step = 0; step < std::atoi(words[2]); ++step) {
    budget.advance(std::strtof(words[1], nullptr), 0.01f, parameters);
    std::printf("%.9g %.9g\n", static_cast<double>(budget.current_limit(parameters)),
                static_cast<double>(budget.spent(parameters)));
  }
}
