/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/law/cells.h for random cells of both shapes. */
#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "anhyst/law/cells.h"
#include "check.h"
#include "truth.h"

#define CELLS 13
#define WIDTHS 3

typedef struct {
  double threshold[CELLS], width[WIDTHS], weight[CELLS * WIDTHS], centre[WIDTHS];
  anhyst_cell_weights_f64 weights;
  anhyst_cells_f64 cells;
  anhyst_cell_piece_f64 *rows;
} sample;

static void build(sample *s)
{
  size_t piece_count = 0;
  CHECK(anhyst_cells_lay_f64(&s->cells, &s->weights, ANHYST_CELLS_AIM, &piece_count) == ANHYST_OK);
  s->rows = malloc(piece_count * sizeof *s->rows);
  anhyst_cells_tabulate_f64(&s->cells, &s->weights, s->rows);
}

/* Random cells with widths and thresholds over a decade; some weights are zero. */
static void make_random_cells(uint64_t *seed, anhyst_shape shape, sample *s)
{
  const double scale = log_uniform(seed, 1.0, 1e4);
  s->threshold[0] = 0.0;
  for (int i = 1; i < CELLS; i++) {
    s->threshold[i] = s->threshold[i - 1] + scale * log_uniform(seed, 0.02, 0.4);
  }
  for (int j = 0; j < WIDTHS; j++) {
    s->width[j] = scale * log_uniform(seed, 0.3, 3.0);
  }
  for (int i = 0; i < CELLS * WIDTHS; i++) {
    const int some = i == 0 || random_bits(seed) % 3 == 0;
    s->weight[i] = some ? 1e4 * log_uniform(seed, 0.01, 1.0) : 0.0;
  }
  /* Half of the sampled laws have centres for all curves except the first. */
  const int has_centres = (int)(random_bits(seed) % 2);
  for (int j = 0; j < WIDTHS; j++) {
    s->centre[j] = j > 0 && has_centres ? scale * log_uniform(seed, 0.1, 2.0) : 0.0;
  }
  const anhyst_cell_weights_f64 w = {CELLS,     WIDTHS, s->threshold, s->width,
                                     s->weight, shape,  s->centre};
  s->weights = w;
  build(s);
}

static double curve(anhyst_shape shape, double z)
{
  return shape == ANHYST_SHAPE_TANH ? tanh(z)
         : fabs(z) < 1e-2           ? z / 3.0 - z * z * z / 45.0 + z * z * z * z * z * 2.0 / 945.0
                                    : 1.0 / tanh(z) - 1.0 / z;
}

/* Returns the magnetisation of x, p_1..p_n by direct sums. */
static double direct_sum(const sample *s, const double *numbers)
{
  double sum = 0.0;
  for (int i = 0; i < CELLS * WIDTHS; i++) {
    const double place = numbers[i / WIDTHS];
    const double centre = s->centre[i % WIDTHS];
    const double width = s->width[i % WIDTHS];
    sum += 0.5 * s->weight[i] *
           (curve(s->weights.shape, (place - centre) / width) +
            curve(s->weights.shape, (place + centre) / width));
  }
  return sum;
}

static double any_field(uint64_t *seed, const sample *s)
{
  const double size = s->cells.scale * log_uniform(seed, 1e-4, 30.0);
  return random_bits(seed) % 2 == 0 ? size : -size;
}

/* Returns a state after a random path; omega is above the onset of jumps. */
static anhyst_cells_state_f64 random_state(uint64_t *seed, const sample *s)
{
  anhyst_cells_state_f64 state;
  memset(&state, 0, sizeof state);
  const int steps = (int)(random_bits(seed) % 12);
  for (int i = 0; i < steps; i++) {
    anhyst_cells_candidate_f64 next;
    CHECK(anhyst_cells_solve_f64(&s->cells, &state, 0.0, 0.1 * any_field(seed, s), &next) ==
          ANHYST_OK);
    anhyst_cells_accept_f64(&s->cells, &state, &next);
  }
  return state;
}

static double error_in_ulps(const sample *s, double omega, double r, double x, double m)
{
  const long double left = (long double)x + (long double)omega * (long double)m - (long double)r;
  const double size = fabs(x) + fabs(r) + fabs(omega) * s->cells.saturation;
  return (double)fabsl(left) / (DBL_EPSILON * size);
}

static void solutions_satisfy_equation_and_direct_sums(anhyst_shape shape)
{
  uint64_t seed = 61 + (uint64_t)shape;
  double residual = 0.0;
  double off = 0.0;
  for (int set = 0; set < 40; set++) {
    sample s;
    make_random_cells(&seed, shape, &s);
    anhyst_cells_state_f64 state = random_state(&seed, &s);
    for (int i = 0; i < 300; i++) {
      const double steepness = log_uniform(&seed, 0.02, 1e4);
      const double omega = (steepness - 1.0) / s.cells.max_slope;
      const double r =
          any_field(&seed, &s) + omega * s.cells.saturation * uniform(&seed, -1.0, 1.0);
      const anhyst_cells_state_f64 before = state;
      anhyst_cells_candidate_f64 next;
      const anhyst_status status = anhyst_cells_solve_f64(&s.cells, &state, omega, r, &next);
      CHECK(status == ANHYST_OK);
      CHECK(memcmp(&before, &state, sizeof state) == 0);
      if (status != ANHYST_OK) {
        continue;
      }
      keep_largest(&residual, error_in_ulps(&s, omega, r, next.x, next.m));
      anhyst_cells_accept_f64(&s.cells, &state, &next);
      double numbers[CELLS];
      anhyst_cells_numbers_f64(&s.cells, &state, numbers);
      keep_largest(&off, fabs(direct_sum(&s, numbers) - state.m) / s.cells.saturation);
    }
    free(s.rows);
  }
  printf("shape %d:\n", (int)shape);
  CHECK_BELOW("  residual in last places of |x| + |r| + |omega|*saturation", residual, 8.0);
  CHECK_BELOW("  m against direct sums after 300 steps, over the saturation", off, 2e-11);
}

/* Returns whether an earlier position also solves the equation. */
static int passes_a_solution(const sample *s, const anhyst_cells_state_f64 *from, double omega,
                             double r, double x)
{
  const double way = x - from->x;
  for (int i = 1; i < 2000; i++) {
    anhyst_cells_candidate_f64 at;
    const double here = from->x + way * (double)i / 2000.0;
    if (anhyst_cells_solve_f64(&s->cells, from, 0.0, here, &at) != ANHYST_OK) {
      return 1;
    }
    const double left = (here + omega * at.m - r) * (way < 0.0 ? -1.0 : 1.0);
    if (left > 1e-9 * (fabs(r) + fabs(omega) * s->cells.saturation)) {
      return 1;
    }
  }
  return 0;
}

static void jump_selects_the_first_solution(anhyst_shape shape)
{
  uint64_t seed = 71 + (uint64_t)shape;
  double residual = 0.0;
  int refused = 0;
  int passed = 0;
  for (int set = 0; set < 40; set++) {
    sample s;
    make_random_cells(&seed, shape, &s);
    anhyst_cells_state_f64 state = random_state(&seed, &s);
    for (int i = 0; i < 8; i++) {
      const double omega = (uniform(&seed, -8.0, 0.0) - 1.0) / s.cells.max_slope;
      const double r = any_field(&seed, &s);
      anhyst_cells_candidate_f64 next;
      const anhyst_status status = anhyst_cells_solve_f64(&s.cells, &state, omega, r, &next);
      const int beyond = 1.0 + omega * s.cells.reversal_slope <= 1e-6;
      CHECK(status == (beyond ? ANHYST_REFUSED : ANHYST_OK));
      refused += beyond;
      if (status == ANHYST_OK) {
        keep_largest(&residual, error_in_ulps(&s, omega, r, next.x, next.m));
        passed += passes_a_solution(&s, &state, omega, r, next.x);
        anhyst_cells_accept_f64(&s.cells, &state, &next);
      }
    }
    free(s.rows);
  }
  printf("shape %d, jumps; %d refused:\n", (int)shape, refused);
  CHECK_BELOW("  residual in last places", residual, 8.0);
  CHECK_BELOW("  solutions passed over", passed, 0.0);
  CHECK(refused > 5 && refused < 300);
}

static void any_numbers_become_a_valid_state(void)
{
  uint64_t seed = 81;
  const double wild[] = {(double)NAN, (double)INFINITY, -(double)INFINITY, 1e9, -1e300};
  sample s;
  make_random_cells(&seed, ANHYST_SHAPE_TANH, &s);
  for (int i = 0; i < 2000; i++) {
    double numbers[CELLS];
    double again[CELLS];
    anhyst_cells_state_f64 state;
    for (int k = 0; k < CELLS; k++) {
      numbers[k] =
          random_bits(&seed) % 3 == 0 ? wild[random_bits(&seed) % 5] : any_field(&seed, &s);
    }
    anhyst_cells_enter_f64(&s.cells, numbers, &state);
    anhyst_cells_numbers_f64(&s.cells, &state, numbers);
    CHECK(fabs(numbers[0]) <= s.cells.x_max);
    for (int k = 1; k < CELLS; k++) {
      const double room = s.threshold[k] - s.threshold[k - 1];
      CHECK(fabs(numbers[k] - numbers[k - 1]) <= room + 1e-15 * (fabs(numbers[k]) + room));
    }
    CHECK(fabs(state.m) <= s.cells.saturation * (1.0 + 1e-11));
    anhyst_cells_enter_f64(&s.cells, numbers, &state);
    anhyst_cells_numbers_f64(&s.cells, &state, again);
    for (int k = 0; k < CELLS; k++) {
      CHECK(fabs(again[k] - numbers[k]) <= 1e-15 * (fabs(numbers[k]) + s.cells.scale));
    }
  }
  free(s.rows);
}

static void unsolvable_input_has_a_status(void)
{
  uint64_t seed = 91;
  const double bad[] = {(double)NAN, (double)INFINITY, -(double)INFINITY};
  sample s;
  make_random_cells(&seed, ANHYST_SHAPE_LANGEVIN, &s);
  for (int i = 0; i < 200; i++) {
    const anhyst_cells_state_f64 state = random_state(&seed, &s);
    anhyst_cells_candidate_f64 next;
    for (int j = 0; j < 3; j++) {
      CHECK(anhyst_cells_solve_f64(&s.cells, &state, 0.1, bad[j], &next) == ANHYST_OUT_OF_RANGE);
      CHECK(anhyst_cells_solve_f64(&s.cells, &state, bad[j], 1.0, &next) == ANHYST_OUT_OF_RANGE);
    }
    const double far = 1.1 * s.cells.x_max;
    CHECK(anhyst_cells_solve_f64(&s.cells, &state, 0.0, far, &next) == ANHYST_OUT_OF_RANGE);
    const double omega = log_uniform(&seed, 1e-12, 1e30);
    const anhyst_status status = anhyst_cells_solve_f64(
        &s.cells, &state, omega, any_field(&seed, &s) * (1.0 + omega), &next);
    CHECK(status == ANHYST_OK || status == ANHYST_OUT_OF_RANGE);
  }
  free(s.rows);
}

static void weights_out_of_range_are_refused(void)
{
  uint64_t seed = 95;
  sample s;
  size_t piece_count;
  make_random_cells(&seed, ANHYST_SHAPE_TANH, &s);
  double *const places[] = {&s.threshold[0], &s.threshold[5], &s.width[1], &s.weight[4],
                            &s.centre[1]};
  const double bad[][3] = {{1.0, -1.0, (double)NAN},
                           {0.0, (double)NAN, (double)INFINITY},
                           {0.0, -1.0, (double)NAN},
                           {-1.0, (double)NAN, (double)INFINITY},
                           {-1.0, (double)NAN, (double)INFINITY}};
  for (int i = 0; i < 5; i++) {
    const double good = *places[i];
    for (int j = 0; j < 3; j++) {
      *places[i] = bad[i][j];
      CHECK(anhyst_cells_lay_f64(&s.cells, &s.weights, ANHYST_CELLS_AIM, &piece_count) ==
            ANHYST_BAD_PARAMETER);
    }
    *places[i] = good;
  }
  s.width[0] = 1e-4 * s.threshold[12];
  CHECK(anhyst_cells_lay_f64(&s.cells, &s.weights, ANHYST_CELLS_AIM, &piece_count) ==
        ANHYST_BAD_PARAMETER);
  free(s.rows);
}

int main(void)
{
  for (int shape = 0; shape < 2; shape++) {
    solutions_satisfy_equation_and_direct_sums((anhyst_shape)shape);
    jump_selects_the_first_solution((anhyst_shape)shape);
  }
  any_numbers_become_a_valid_state();
  unsolvable_input_has_a_status();
  weights_out_of_range_are_refused();
  return verdict();
}
