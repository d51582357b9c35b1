// Answers, time and stack of the coordinator on random and adversarial problems: the same program for this
// computer and for emulated processors (`python firmware/emulate.py`). All arithmetic is that of IEEE, so that all
// print the same hash.
#include <algorithm>
#include <cstdint>
#include <cstring>

#include "firmware/coordinator/coordinator.hpp"

#if !defined(N_COMPONENTS)
#define N_COMPONENTS 3
#define M_CABLES 8
#define PROBLEMS 1000
#define ITERATION_LIMIT 2000
#define POLICY 0
#endif

// Of the platform: a counter of instructions in units of kInstructionsPerTick, text out, and the lowest address of
// the stack.
extern "C" {
uint32_t platform_ticks(void);
void platform_write(const char* text, unsigned size);
extern const uint32_t platform_instructions_per_tick;
extern unsigned char* const platform_stack_end;
}

namespace {

using namespace tensionlab;
constexpr int N = N_COMPONENTS, M = M_CABLES, kProblems = PROBLEMS;

void print(const char* name, uint32_t number) {
  char text[64];
  unsigned size = 0;
  while (*name != 0) text[size++] = *name++;
  char digits[10];
  int count = 0;
  do {
    digits[count++] = static_cast<char>('0' + number % 10);
    number /= 10;
  } while (number > 0);
  while (count > 0) text[size++] = digits[--count];
  text[size++] = '\n';
  platform_write(text, size);
}

class Random {
 public:
  uint32_t bits() {
    state_ ^= state_ << 13;
    state_ ^= state_ >> 17;
    return state_ ^= state_ << 5;
  }
  int below(int count) { return static_cast<int>((bits() >> 8) % static_cast<uint32_t>(count)); }
  float uniform(float least, float most) {
    return least + (most - least) * static_cast<float>(bits() >> 8) / 16777216.0F;
  }

 private:
  uint32_t state_ = 2463534242U;
};

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

void add(uint32_t& hash, const void* bytes, size_t size) {
  for (size_t i = 0; i < size; ++i) hash = (hash ^ static_cast<const uint8_t*>(bytes)[i]) * 16777619U;
}

// Fills the unused stack, and finds how much of it was used since.
constexpr unsigned char kUnused = 0xA5;
constexpr size_t kReserve = 512;  // of the function that fills

TENSIONLAB_NOINLINE void fill_stack() {
  unsigned char* const top = static_cast<unsigned char*>(__builtin_frame_address(0)) - kReserve;
  for (unsigned char* place = platform_stack_end; place < top; ++place)
    *static_cast<volatile unsigned char*>(place) = kUnused;
}

TENSIONLAB_NOINLINE uint32_t used_stack(const unsigned char* top) {
  const unsigned char* place = platform_stack_end;
  while (place < top && *static_cast<const volatile unsigned char*>(place) == kUnused) ++place;
  return static_cast<uint32_t>(top - place);
}

}  // namespace

extern "C" int bench(void) {
  const float zeros[M] = {};
  static firmware::CoordinatorModule<N, M> coordinator(zeros, zeros, 7, 50, ITERATION_LIMIT);
  Random random;
  Drawn drawn;
  uint32_t hash = 2166136261U, counts[4] = {}, outside = 0, most_iterations = 0;
  coordinator.allocator().policy = static_cast<Policy>(POLICY);
  if (platform_stack_end != nullptr) fill_stack();
  for (int problem = 0; problem < kProblems; ++problem) {
    draw(random, drawn);
    for (int i = 0; i < M; ++i) {
      coordinator.allocator().lower[i] = drawn.lower[i];
      coordinator.allocator().upper[i] = drawn.upper[i];
    }
    const uint32_t begin = platform_ticks();
    const auto& answer = coordinator.command(drawn.structure, drawn.wrench, frames, sizes);
    ticks[problem] = (platform_ticks() - begin) & 0xFFFFFFU;
    for (int i = 0; i < M; ++i) {
      add(hash, frames[i], sizes[i]);
      outside += answer.tensions[i] >= drawn.lower[i] && answer.tensions[i] <= drawn.upper[i] ? 0 : 1;
    }
    add(hash, answer.separation, sizeof answer.separation);
    add(hash, &answer.status, 1);
    ++counts[static_cast<int>(answer.status)];
    most_iterations = std::max(most_iterations, static_cast<uint32_t>(answer.iterations));
  }
  const uint32_t stack =
      platform_stack_end != nullptr ? used_stack(static_cast<unsigned char*>(__builtin_frame_address(0))) : 0;
  std::sort(ticks, ticks + kProblems);
  const uint32_t unit = platform_instructions_per_tick;
  print("hash ", hash);
  print("exact ", counts[0]);
  print("nearest ", counts[1]);
  print("unproven ", counts[2]);
  print("outside ", outside);
  print("iterations ", most_iterations);
  print("object ", sizeof coordinator);
  print("stack ", stack);
  print("median ", unit * ticks[kProblems / 2]);
  print("p999 ", unit * ticks[kProblems - 1 - kProblems / 1000]);
  print("worst ", unit * ticks[kProblems - 1]);
  return 0;
}
