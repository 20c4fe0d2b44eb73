/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of a force controller in SI units that calls one in fixed point. The inner controller has
   its own method, which records its input codes. */
#include "anhyst/compensator/force_coded_real.h"

#include <float.h>

#include "check.h"
#include "maps.h"

static const double CODES = 2147483648.0;
static int32_t asked[3]; /* demand or current, gap, flux */
static int32_t answer;

static int32_t solve(anhyst_force_controller_q31 *c, int32_t demand, int32_t gap, int32_t flux)
{
  asked[0] = demand;
  asked[1] = gap;
  asked[2] = flux;
  c->flags = ANHYST_FLUX_LIMITED;
  return answer;
}

static int32_t commit(anhyst_force_controller_q31 *c, int32_t applied, int32_t gap)
{
  (void)c;
  asked[0] = applied;
  asked[1] = gap;
  return answer;
}

static const anhyst_force_method_q31 telling = {.solve = solve, .commit = commit};

static double any_part(void) { return (double)any_code() / CODES; }

/* Returns the error of a code, in codes, above the error that the outer format permits. */
static double code_error(int32_t code, double signal, double epsilon)
{
  return fabs((double)code - signal * CODES) - 2.0 * epsilon * fabs(signal) * CODES;
}

#define CLAIMS(f, REAL, EPSILON)                                                                   \
  static void codes_are_the_signals_##f(void)                                                      \
  {                                                                                                \
    anhyst_force_controller_q31 inner = {.method = &telling};                                      \
    anhyst_force_controller_##f c;                                                                 \
    anhyst_coded_##f coded;                                                                        \
    const anhyst_code_scales_##f scales = {(REAL)250.0, (REAL)5.0, (REAL)2.0, (REAL)0.35,          \
                                           (REAL)0.55};                                            \
    double worst = 0.0;                                                                            \
    double back = 0.0;                                                                             \
    CHECK(anhyst_force_controller_init_coded_##f(&c, &coded, &scales, &inner) == ANHYST_OK);       \
    for (int i = 0; i < 20000; i++) {                                                              \
      const REAL force = (REAL)(249.0 * any_part());                                               \
      const REAL current = (REAL)(4.9 * any_part());                                               \
      const REAL flux = (REAL)(1.9 * any_part());                                                  \
      const REAL gap = (REAL)(0.45 + 0.0999 * any_part());                                         \
      const double range = (double)scales.gap_high - (double)scales.gap_low;                       \
      const double part = ((double)gap - (double)scales.gap_low) / range;                          \
      answer = any_code();                                                                         \
      const double found = (double)anhyst_force_controller_solve_##f(&c, force, gap, flux);        \
      keep_largest(&worst, code_error(asked[0], (double)force / 250.0, EPSILON));                  \
      keep_largest(&worst, code_error(asked[1], part > 0.0 ? part : 0.0, EPSILON));                \
      keep_largest(&worst, code_error(asked[2], (double)flux / 2.0, EPSILON));                     \
      keep_largest(&back, code_error(answer, found / 5.0, EPSILON));                               \
      CHECK(c.flags == ANHYST_FLUX_LIMITED);                                                       \
      const double left = (double)anhyst_force_controller_commit_##f(&c, current, gap);            \
      keep_largest(&worst, code_error(asked[0], (double)current / 5.0, EPSILON));                  \
      keep_largest(&back, code_error(answer, left / 250.0, EPSILON));                              \
    }                                                                                              \
    CHECK_BELOW("a signal to its code beyond rounding, codes", worst, 1.0);                        \
    CHECK_BELOW("and back", back, 1e-3);                                                           \
  }                                                                                                \
                                                                                                   \
  static void what_is_beyond_becomes_its_end_##f(void)                                             \
  {                                                                                                \
    static const double no_number[] = {(double)NAN, -(double)INFINITY, -1e30};                     \
    anhyst_force_controller_q31 inner = {.method = &telling};                                      \
    anhyst_force_controller_##f c;                                                                 \
    anhyst_coded_##f coded;                                                                        \
    const anhyst_code_scales_##f scales = {(REAL)250.0, (REAL)5.0, (REAL)2.0, (REAL)0.35,          \
                                           (REAL)0.55};                                            \
    CHECK(anhyst_force_controller_init_coded_##f(&c, &coded, &scales, &inner) == ANHYST_OK);       \
    for (int i = 0; i < 3; i++) {                                                                  \
      (void)anhyst_force_controller_solve_##f(&c, (REAL)no_number[i], (REAL)no_number[i],          \
                                              (REAL)no_number[i]);                                 \
      CHECK(asked[0] == ANHYST_Q31_MIN && asked[1] == 0 && asked[2] == ANHYST_NO_FLUX);            \
      (void)anhyst_force_controller_commit_##f(&c, (REAL)no_number[i], (REAL)no_number[i]);        \
      CHECK(asked[0] == ANHYST_Q31_MIN && asked[1] == 0);                                          \
    }                                                                                              \
    (void)anhyst_force_controller_solve_##f(&c, (REAL)100.0, (REAL)NAN, (REAL)0.0);                \
    CHECK(asked[0] == ANHYST_Q31_MIN && asked[2] == 0);                                            \
    (void)anhyst_force_controller_solve_##f(&c, (REAL)1e30, (REAL)INFINITY, (REAL)1e30);           \
    CHECK(asked[0] == ANHYST_Q31_MAX && asked[1] == ANHYST_Q31_MAX && asked[2] == ANHYST_Q31_MAX); \
  }                                                                                                \
                                                                                                   \
  static void scales_that_are_none_are_refused_##f(void)                                           \
  {                                                                                                \
    static const double wrong[] = {0.0, -1.0, (double)NAN, 1e-39, (double)INFINITY};               \
    anhyst_force_controller_q31 inner = {.method = &telling};                                      \
    for (int i = 0; i < 25; i++) {                                                                 \
      anhyst_force_controller_##f c = {.low = (REAL)7.0};                                          \
      anhyst_coded_##f coded;                                                                      \
      REAL one[5] = {(REAL)1.0, (REAL)1.0, (REAL)1.0, (REAL)0.0, (REAL)1.0};                       \
      one[i % 5] = (REAL)wrong[i / 5];                                                             \
      const anhyst_code_scales_##f scales = {one[0], one[1], one[2], one[3], one[4]};              \
      const anhyst_status status =                                                                 \
          anhyst_force_controller_init_coded_##f(&c, &coded, &scales, &inner);                     \
      const int fine = i % 5 == 3 && isfinite(one[3]);                                             \
      CHECK(status == (fine ? ANHYST_OK : ANHYST_BAD_PARAMETER));                                  \
      CHECK(fine || c.low == (REAL)7.0);                                                           \
    }                                                                                              \
  }
CLAIMS(f64, double, DBL_EPSILON)
CLAIMS(f32, float, (double)FLT_EPSILON)

/* With the method map inside: the current is that of the inner controller, all functions of the
   method exist, and the expected force is the demand. */
static void coded_map_matches_the_map(void)
{
  static const int16_t entries[] = {0, 16384, 32767, 0, 8192, 24576};
  const anhyst_map_q31 map = {entries, 1, 0};
  const anhyst_code_scales_f32 scales = {100.0F, 4.0F, 1.0F, 1.0F, 2.0F};
  anhyst_force_controller_q31 inner;
  anhyst_force_controller_f32 c;
  anhyst_coded_f32 coded;
  CHECK(anhyst_force_controller_init_map_q31(&inner, &map, 0, ANHYST_Q31_MAX) == ANHYST_OK);
  CHECK(anhyst_force_controller_init_coded_f32(&c, &coded, &scales, &inner) == ANHYST_OK);
  CHECK_BELOW("current of half the force",
              fabsf(anhyst_force_controller_solve_f32(&c, 50.0F, 1.0F, 0.0F) - 2.0F), 1e-6F);
  CHECK_BELOW("at the other gap",
              fabsf(anhyst_force_controller_solve_f32(&c, 50.0F, 2.0F, 0.0F) - 1.0F), 1e-3F);
  CHECK_BELOW("and the force of what was solved",
              fabsf(anhyst_force_controller_commit_f32(&c, c.current, 2.0F) - 50.0F), 1e-3F);
  CHECK_BELOW("expected", fabsf(anhyst_force_controller_expected_f32(&c, 1.0F, 2.0F) - 50.0F),
              0.1F);
  CHECK(anhyst_force_controller_conditioning_length_f32(&c) == 0);
  CHECK(anhyst_force_controller_conditioning_f32(&c, 0) == 0.0F);
  anhyst_force_controller_demagnetise_f32(&c);
  anhyst_force_controller_carry_f32(&c, 0);
}

int main(void)
{
  codes_are_the_signals_f64();
  codes_are_the_signals_f32();
  what_is_beyond_becomes_its_end_f64();
  what_is_beyond_becomes_its_end_f32();
  scales_that_are_none_are_refused_f64();
  scales_that_are_none_are_refused_f32();
  coded_map_matches_the_map();
  return verdict();
}
