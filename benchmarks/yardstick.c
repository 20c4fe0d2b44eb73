/* A fixed amount of scalar double-precision work for comparing processors. Each step is a
 * polynomial of twelve terms and a division, similar to an exponential or a Langevin function. Each
 * step needs the result of the previous step, so that no steps run in parallel. No library is used.
 * The program prints the processor time of one step in nanoseconds: the shortest of several
 * repetitions, because other work on the machine can only add time. */
#include <stdio.h>
#include <time.h>

#define STEPS 2000000
#define REPETITIONS 15

static const double INVERSE[12] = {1.0,       1.0,       1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0,  1.0 / 5.0,
                                   1.0 / 6.0, 1.0 / 7.0, 1.0 / 8.0, 1.0 / 9.0, 1.0 / 10.0, 1.0 / 11.0};

static double step(double x)
{
  double sum = 1.0;
  for (int n = 11; n > 0; n--) {
    sum = 1.0 + sum * (x * INVERSE[n]);
  }
  return 1.0 / (0.5 + sum);
}

int main(void)
{
  double best = 1e9;
  double x = 0.3;
  for (int repetition = 0; repetition < REPETITIONS; repetition++) {
    clock_t began = clock();
    for (int n = 0; n < STEPS; n++) {
      x = step(x);
    }
    double spent = (double)(clock() - began) / CLOCKS_PER_SEC;
    best = spent < best ? spent : best;
  }
  if (!(x > 0.0 && x < 1.0)) {
    return 1;
  }
  printf("%.6f\n", 1e9 * best / STEPS);
  return 0;
}
