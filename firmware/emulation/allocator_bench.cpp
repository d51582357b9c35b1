// Answers, instructions and stack of the coordinator on random and adversarial problems: the same program for this
// computer and for emulated processors (`python firmware/emulate.py`). All arithmetic is that of IEEE, so that all
// print the same hash.
#include <algorithm>
#include <cstdint>

#include "bench.hpp"
#include "firmware/coordinator/coordinator.hpp"

#if !defined(N_COMPONENTS)
#define N_COMPONENTS 3
#define M_CABLES 8
#define PROBLEMS 1000
#define ITERATION_LIMIT 2000
#define POLICY 0
#endif

namespace {

using namespace tensionlab;
using emulation::print;
using emulation::Random;
constexpr int N = N_COMPONENTS, M = M_CABLES, kProblems = PROBLEMS;

struct Drawn {
  float structure[N * M], wrench[N], lower[M], upper[M];
};

// A point with M cables, or a platform of 0.3 m; then what solvers find hard: parallel, absent and duplicate
// cables, rows that nearly depend on others, cables without room, wrenches on a facet of the feasible set, a hair
// beside it, far outside, or zero.
void draw(Random& random, Drawn& drawn) {
  const int kind = random.below(8), place = random.below(6);
  for (int i = 0; i < M; ++i) {
    float direction[3], square = 0;
    for (float& part : direction) {
      part = random.uniform(-1, 1);
      square += part * part;
    }
    const float length = std::sqrt(square);
    float column[6], arm[3];
    for (int k = 0; k < 3; ++k) {
      column[k] = length > 0 ? direction[k] / length : 1.0F;
      arm[k] = random.uniform(-0.3F, 0.3F);
    }
    for (int k = 0; k < 3; ++k) {
      column[3 + k] = arm[(k + 1) % 3] * column[(k + 2) % 3] - arm[(k + 2) % 3] * column[(k + 1) % 3];
    }
    for (int k = 0; k < N; ++k) {
      drawn.structure[k * M + i] = kind == 1 ? static_cast<float>(random.below(5) - 2) / 2 : column[k];
    }
    drawn.lower[i] = kind == 2 ? random.uniform(0, 2) : 0.5F;
    drawn.upper[i] = kind == 2 ? drawn.lower[i] + static_cast<float>(random.below(3)) * 3 : 6.0F;
  }
  for (int k = 0; k < N; ++k) {
    float* row = drawn.structure + k * M;
    if (kind == 3) row[M - 1] = row[0];
    if (kind == 4) row[M - 1] = -2 * row[0];
    if (kind == 5 && k == N - 1) {
      const float share = random.uniform(0, 1e-3F);
      for (int i = 0; i < M; ++i) row[i] = drawn.structure[i] + share * row[i];
    }
  }
  float tensions[M], d[N];
  for (float& part : d) part = random.uniform(-1, 1);
  for (int i = 0; i < M; ++i) {
    float along = 0;
    for (int k = 0; k < N; ++k) along += d[k] * drawn.structure[k * M + i];
    tensions[i] = along > 0 ? drawn.upper[i] : drawn.lower[i];
    if (place < 2 || (place < 4 && i < N - 1)) tensions[i] = random.uniform(drawn.lower[i], drawn.upper[i]);
  }
  const float factor = place == 3 ? 1 + random.uniform(-1e-4F, 1e-4F) : place == 5 ? random.uniform(1, 20) : 1.0F;
  for (int k = 0; k < N; ++k) {
    drawn.wrench[k] = 0;
    for (int i = 0; i < M; ++i) drawn.wrench[k] += factor * drawn.structure[k * M + i] * tensions[i];
    if (place == 4) drawn.wrench[k] = 0;
  }
}

uint32_t ticks[kProblems];
uint8_t frames[M][firmware::kMaxFrame];
size_t sizes[M];

}  // namespace

extern "C" int bench(void) {
  const float zeros[M] = {};
  static firmware::CoordinatorModule<N, M> coordinator(zeros, zeros, 7, 50, ITERATION_LIMIT);
  Random random;
  Drawn drawn;
  emulation::Hash hash;
  uint32_t counts[4] = {}, outside = 0, most_iterations = 0;
  coordinator.allocator().policy = static_cast<Policy>(POLICY);
  emulation::fill_stack();
  for (int problem = 0; problem < kProblems; ++problem) {
    draw(random, drawn);
    for (int i = 0; i < M; ++i) {
      coordinator.allocator().lower[i] = drawn.lower[i];
      coordinator.allocator().upper[i] = drawn.upper[i];
    }
    const uint32_t begin = platform_ticks();
    const auto& answer = coordinator.command(drawn.structure, drawn.wrench, frames, sizes);
    ticks[problem] = emulation::ticks_since(begin);
    for (int i = 0; i < M; ++i) {
      hash.add(frames[i], sizes[i]);
      outside += answer.tensions[i] >= drawn.lower[i] && answer.tensions[i] <= drawn.upper[i] ? 0 : 1;
    }
    hash.add(answer.separation, sizeof answer.separation);
    hash.add(&answer.status, 1);
    ++counts[static_cast<int>(answer.status)];
    most_iterations = std::max(most_iterations, static_cast<uint32_t>(answer.iterations));
  }
  const uint32_t stack = emulation::used_stack(__builtin_frame_address(0));
  std::sort(ticks, ticks + kProblems);
  print("hash", hash.value());
  print("exact", counts[0]);
  print("nearest", counts[1]);
  print("unproven", counts[2]);
  print("outside", outside);
  print("iterations", most_iterations);
  print("object", sizeof coordinator);
  print("stack", stack);
  print("median", platform_instructions(ticks[kProblems / 2]));
  print("p999", platform_instructions(ticks[kProblems - 1 - kProblems / 1000]));
  print("worst", platform_instructions(ticks[kProblems - 1]));
  return 0;
}
