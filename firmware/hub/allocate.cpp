// Tension allocation on a module's own processor: the package's exact solver in single precision, one problem at a
// time, for a point pulled by up to eight cables. One hub module could allocate for its neighbours with it;
// nothing calls it yet.
#include "../../tensionlab/native/newton.hpp"

namespace {

constexpr int kComponents = 3, kCables = 8;
using Solver = tensionlab::Newton<float, 1, kComponents, kCables>;

constexpr float kOnes[kComponents] = {1.0f, 1.0f, 1.0f};
constexpr float kZeros[kCables] = {};
constexpr float kRankTolerance = 1e-4f, kTolerance = 1e-4f;

}  // namespace

// The tensions inside the limits whose sum of squares is least among those that render the wrench, or else that
// come closest to it. structure: three rows of so many cables; all in N. Returns the Newton steps taken, at most
// some tens.
extern "C" int allocate_tensions(int cables, const float* structure, const float* wrench, const float* lower,
                                 const float* upper, float* tensions) {
  Solver solver(cables, kOnes, tensionlab::Policy::force, kRankTolerance, kTolerance);
  solver.load(0, {structure, wrench, lower, upper, kZeros});
  do {
    solver.step();
  } while (!solver.finished(0));
  float separation[kComponents];
  return solver.store(0, tensions, separation);
}
