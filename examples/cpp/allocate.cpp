// Tensions of four cables for a force, and the proof where there are none: headers only, float as on a
// microcontroller.
#include <cstdio>
#include <tensionlab/allocate.hpp>

namespace {

// Four cables from the corners of a square, 1 m by 1 m, to a point in its middle and 0.4 m in front of it.
constexpr int kComponents = 3, kCables = 4;
constexpr float kSide = 0.615457F, kFront = 0.492366F;  // of the cables' directions
const float structure[kComponents * kCables] = {
    -kSide,  kSide,   -kSide,  kSide,    // x
    -kSide,  -kSide,  kSide,   kSide,    // y
    -kFront, -kFront, -kFront, -kFront,  // z
};
const float lower[kCables] = {0.5F, 0.5F, 0.5F, 0.5F}, upper[kCables] = {6, 6, 6, 6};

void show(const tensionlab::Allocation<float, kComponents, kCables>& answer) {
  const bool exact = answer.status == tensionlab::Status::exact;
  std::printf("%s after %d iterations: tensions", exact ? "exact" : "nearest", answer.iterations);
  for (const float tension : answer.tensions) std::printf(" %.3f", double{tension});
  std::printf(" N render %.3f %.3f %.3f N\n", double{answer.wrench[0]}, double{answer.wrench[1]},
              double{answer.wrench[2]});
  if (!exact) {
    std::printf("  infeasible: %.3f %.3f %.3f separates it\n", double{answer.separation[0]},
                double{answer.separation[1]}, double{answer.separation[2]});
  }
}

}  // namespace

int main() {
  tensionlab::Allocator<float, kComponents, kCables> allocator(lower, upper);
  const float feasible[] = {1, 0.5F, -5}, infeasible[] = {6, 0, -4};
  show(allocator(structure, feasible));
  allocator.policy = tensionlab::Policy::direction;  // the longest force in the same direction
  show(allocator(structure, infeasible));
  allocator.policy = tensionlab::Policy::force;  // the nearest force
  allocator.iteration_limit = 50;                // bounds the time of a call
  show(allocator(structure, infeasible));
}
