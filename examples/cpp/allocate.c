/* Tensions of four cables for a force, and the proof where there are none: the library in C. */
#include <stdio.h>
#include <tensionlab.h>

enum { COMPONENTS = 3, CABLES = 4 };

/* Four cables from the corners of a square, 1 m by 1 m, to a point in its middle and 0.4 m in front of it. */
#define SIDE 0.615457
#define FRONT 0.492366
static const double structure[COMPONENTS * CABLES] = {
    -SIDE,  SIDE,   -SIDE,  SIDE,   /* x */
    -SIDE,  -SIDE,  SIDE,   SIDE,   /* y */
    -FRONT, -FRONT, -FRONT, -FRONT, /* z */
};
static const double lower[CABLES] = {0.5, 0.5, 0.5, 0.5}, upper[CABLES] = {6, 6, 6, 6};

static void show(const double* wrench, enum tensionlab_policy policy) {
  double tensions[CABLES];
  tensionlab_result result;
  const int status = tensionlab_allocate(COMPONENTS, CABLES, structure, wrench, lower, upper, NULL, NULL, policy,
                                         tensions, &result);
  if (status < 0) {
    printf("an argument is out of range\n");
    return;
  }
  printf("%s: tensions", status == TENSIONLAB_EXACT ? "exact" : "nearest");
  for (int i = 0; i < CABLES; ++i) printf(" %.3f", tensions[i]);
  printf(" N render %.3f %.3f %.3f N\n", result.wrench[0], result.wrench[1], result.wrench[2]);
  if (status != TENSIONLAB_EXACT) {
    const double* d = result.separation;
    printf("  infeasible: %.3f %.3f %.3f separates it\n", d[0], d[1], d[2]);
  }
}

int main(void) {
  const double feasible[] = {1, 0.5, -5}, infeasible[] = {6, 0, -4};
  printf("tensionlab %s\n", tensionlab_version());
  show(feasible, TENSIONLAB_FORCE);
  show(infeasible, TENSIONLAB_DIRECTION);
  show(infeasible, TENSIONLAB_FORCE);
  return 0;
}
