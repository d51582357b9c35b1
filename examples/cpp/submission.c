/* Solves a track of the benchmark: `unzip edge-1.npz -d problems && submission problems answers`.

   The folder of problems has structure.npy, wrench.npy, lower.npy and upper.npy, of doubles; the program writes
   tensions.npy and times_s.npy, the seconds of each call, into the folder of answers, which must exist. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tensionlab.h>
#include <time.h>

enum { REPEATS = 5, HEADER = 118 }; /* calls of each problem; bytes that make data begin at a multiple of 64 */

static void require(int met, const char* what) {
  if (met) return;
  fprintf(stderr, "submission: %s\n", what);
  exit(2);
}

static FILE* open_in(const char* folder, const char* name, const char* mode) {
  char path[4096];
  snprintf(path, sizeof path, "%s/%s.npy", folder, name);
  FILE* file = fopen(path, mode);
  require(file != NULL, path);
  return file;
}

/* Returns the numbers of an array and its shape. NumPy's format: 10 bytes, of which the last two are the length of
   a text with type and shape; then the numbers, row by row. */
static double* read_array(const char* folder, const char* name, int shape[3]) {
  FILE* file = open_in(folder, name, "rb");
  unsigned char start[10];
  static char text[65536];
  require(fread(start, 10, 1, file) && fread(text, start[8] + 256 * start[9], 1, file), "no array of NumPy");
  const char* sizes = strstr(text, "'shape': (");
  shape[1] = shape[2] = 1;
  require(sizes && sscanf(sizes, "'shape': (%d, %d, %d", shape, shape + 1, shape + 2) > 0, "no shape in an array");
  require(strstr(text, "<f8") && strstr(text, "False"), "no array of doubles, row by row");
  const size_t count = (size_t)shape[0] * shape[1] * shape[2];
  double* numbers = malloc(count * sizeof *numbers);
  require(numbers && fread(numbers, sizeof *numbers, count, file) == count, "an array is cut off");
  fclose(file);
  return numbers;
}

static void write_array(const char* folder, const char* name, const double* numbers, const char* shape,
                        int count) {
  FILE* file = open_in(folder, name, "wb");
  char text[HEADER + 1];
  snprintf(text, sizeof text, "{'descr': '<f8', 'fortran_order': False, 'shape': (%s), }", shape);
  fprintf(file, "\x93NUMPY\x01%c%c%c%-*s\n", 0, HEADER, 0, HEADER - 1, text);
  fwrite(numbers, sizeof *numbers, count, file);
  fclose(file);
}

static double seconds_between(struct timespec began, struct timespec ended) {
  return (double)(ended.tv_sec - began.tv_sec) + 1e-9 * (double)(ended.tv_nsec - began.tv_nsec);
}

int main(int count, char** words) {
  require(count == 3, "usage: submission PROBLEMS ANSWERS");
  int size[3], other[3];
  const double* structure = read_array(words[1], "structure", size);
  const double* wrench = read_array(words[1], "wrench", other);
  const double* lower = read_array(words[1], "lower", other);
  const double* upper = read_array(words[1], "upper", other);
  const int problems = size[0], n = size[1], m = size[2];
  double* tensions = calloc((size_t)problems * m, sizeof *tensions);
  double* times = malloc(problems * sizeof *times);
  for (int i = 0; i < problems; ++i) {
    times[i] = 1e9;
    for (int repeat = 0; repeat < REPEATS; ++repeat) {
      struct timespec began, ended;
      timespec_get(&began, TIME_UTC);
      tensionlab_allocate(n, m, structure + i * n * m, wrench + i * n, lower + i * m, upper + i * m, NULL, NULL,
                          TENSIONLAB_FORCE, tensions + i * m, NULL);
      timespec_get(&ended, TIME_UTC);
      const double spent = seconds_between(began, ended);
      if (spent < times[i]) times[i] = spent;
    }
  }
  char shape[64];
  snprintf(shape, sizeof shape, "%d, %d", problems, m);
  write_array(words[2], "tensions", tensions, shape, problems * m);
  snprintf(shape, sizeof shape, "%d,", problems);
  write_array(words[2], "times_s", times, shape, problems);
  return 0;
}
