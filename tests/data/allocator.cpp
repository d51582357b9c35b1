// The headers for C++ as a microcontroller compiles them: problems from the input, answers to the output, no heap.
#include <cstdio>
#include <cstdlib>

#include "tensionlab/allocate.hpp"

namespace {

template <class Real, int N, int M>
int answer_all(tensionlab::Policy policy, int iteration_limit) {
  Real numbers[N * M + N + 3 * M] = {};  // structure, wrench, lower, upper, reference
  const Real *wrench = numbers + N * M, *lower = wrench + N, *upper = lower + M, *reference = upper + M;
  tensionlab::Allocator<Real, N, M> allocator(lower, upper);
  allocator.policy = policy;
  if (iteration_limit > 0) allocator.iteration_limit = iteration_limit;
  while (std::fread(numbers, sizeof numbers, 1, stdin) == 1) {
    for (int i = 0; i < M; ++i) {
      allocator.lower[i] = lower[i];
      allocator.upper[i] = upper[i];
      allocator.reference[i] = reference[i];
    }
    const auto& found = allocator(numbers, wrench);
    const Real rest[] = {static_cast<Real>(static_cast<int>(found.status)), static_cast<Real>(found.iterations),
                         found.residual, found.scale};
    std::fwrite(found.tensions, sizeof(Real), M, stdout);
    std::fwrite(found.wrench, sizeof(Real), N, stdout);
    std::fwrite(found.separation, sizeof(Real), N, stdout);
    std::fwrite(rest, sizeof(Real), 4, stdout);
  }
  return 0;
}

template <int N, int M>
int answer_in(const char* precision, tensionlab::Policy policy, int iteration_limit) {
  return *precision == 'f' ? answer_all<float, N, M>(policy, iteration_limit)
                           : answer_all<double, N, M>(policy, iteration_limit);
}

}  // namespace

// float or double, components, cables, policy, iteration limit or 0.
int main(int, char** words) {
  const int n = std::atoi(words[2]), m = std::atoi(words[3]), limit = std::atoi(words[5]);
  const auto policy = static_cast<tensionlab::Policy>(std::atoi(words[4]));
  if (n == 3 && m == 4) return answer_in<3, 4>(words[1], policy, limit);
  if (n == 3 && m == 8) return answer_in<3, 8>(words[1], policy, limit);
  if (n == 6 && m == 8) return answer_in<6, 8>(words[1], policy, limit);
  return 1;
}
