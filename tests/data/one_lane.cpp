// The exact solver as a module's own processor would run it: float, one lane, one translation unit, no heap.
#include <cstdio>

#include "tensionlab/solvers/newton.hpp"

using Solver = tensionlab::Newton<float, 1, 2, 8>;

int main() {
  const float structure[] = {1, -0.6F, -0.6F, 0, 0.8F, -0.8F}, lower[] = {1, 1, 1}, upper[] = {10, 10, 10};
  const float reference[] = {0, 0, 0}, weight_roots[] = {1, 1}, reachable[] = {1, 2}, unreachable[] = {12, 6};
  const tensionlab::Policy policies[] = {tensionlab::Policy::force, tensionlab::Policy::tension,
                                         tensionlab::Policy::direction};
  for (const auto policy : policies) {
    Solver solver(3, weight_roots, policy, 1e-4F, 1e-4F);
    for (int problem = 0; problem < 2; ++problem) {
      solver.load(0, {structure, problem == 0 ? reachable : unreachable, lower, upper, reference});
      do {
        solver.step();
      } while (!solver.finished(0));
      float tensions[3], separation[2];
      const int iterations = solver.store(0, tensions, separation);
      std::printf("%.6g %.6g %.6g %d\n", static_cast<double>(tensions[0]), static_cast<double>(tensions[1]),
                  static_cast<double>(tensions[2]), iterations);
    }
  }
}
