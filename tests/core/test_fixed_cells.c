/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the play-cell law in fixed point, compared with sums of its curves in double precision
   at the resulting fields. */
/* The test calls their static functions. */
#include "compensator/cells.c"       /* NOLINT(bugprone-suspicious-include) */
#include "compensator/compensator.c" /* NOLINT(bugprone-suspicious-include) */

#include "cell_words.h"
#include "check.h"
#include "truth.h"

/* Maximum error of linear interpolation over segments of 1/128 and 1/64 of this curve, with 16
   bits. */
static const double OFF = 2.5e-4;

enum { STEPS = 20000 };

static double plays[CELLS + 1];

/* Moves the plays to a field. Returns h*x + m. */
static double follow_field(double x)
{
  double flux = AIR * x;
  for (int cell = 0; cell <= CELLS; cell++) {
    const double r = THRESHOLDS[cell];
    plays[cell] = fmin(fmax(plays[cell], x - r), x + r);
    flux += curve(cell, plays[cell]);
  }
  return flux;
}

static double as_number(int32_t q30) { return (double)q30 / (double)ANHYST_Q30_ONE; }

/* Returns the next flux of a random path: steps of any size, and sometimes a jump over the
   range. */
static int32_t next_flux(int32_t flux, uint64_t *seed)
{
  const int shift = (int)(random_bits(seed) % 12U);
  const double step = ((double)(random_bits(seed) % 65536U) / 32768.0 - 1.0) / (double)(1 << shift);
  return (int32_t)(fmin(fmax(as_number(flux) + step, -0.85), 0.85) * (double)ANHYST_Q30_ONE);
}

/* Returns a state of zeros, in which the cells at rest are unknown. */
static anhyst_compensator demagnetised(void)
{
  const anhyst_compensator none = {.kernel = &anhyst_kernel_cells, .words = words};
  for (int cell = 0; cell <= CELLS; cell++) {
    plays[cell] = 0.0;
  }
  return none;
}

static int32_t solve_field_for(anhyst_compensator *c, int32_t flux)
{
  c->flux = flux;
  const int32_t x = cells_field_for_flux(c);
  c->stage = ANHYST_STAGE_AHEAD;
  return x;
}

static void commit_step(anhyst_compensator *c)
{
  cells_store_plays(c);
  c->memory = c->next.memory;
  c->stage = ANHYST_STAGE_HERE;
}

static void solved_field_gives_the_demanded_flux(void)
{
  anhyst_compensator c = demagnetised();
  uint64_t seed = 11;
  int32_t flux = 0;
  double worst = 0.0;
  for (int i = 0; i < STEPS; i++) {
    flux = next_flux(flux, &seed);
    const int32_t x = solve_field_for(&c, flux);
    commit_step(&c);
    keep_largest(&worst, fabs(follow_field(as_number(x)) - as_number(flux)));
  }
  CHECK_BELOW("flux", worst, OFF);
}

/* The applied current is near the solved current, as after a converter, or any current. */
static void current_gives_a_consistent_state(void)
{
  const anhyst_arms arms = {0, 12000, 16000};
  const double arm = 12000.0 / 65536.0;
  const double field_arm = 16000.0 / 65536.0;
  anhyst_compensator c = demagnetised();
  uint64_t seed = 5;
  int32_t flux = 0;
  double worst = 0.0;
  c.arms = arms;
  for (int i = 0; i < STEPS; i++) {
    flux = next_flux(flux, &seed);
    const int32_t x = solve_field_for(&c, flux);
    const double solved = arm * as_number(flux) + field_arm * as_number(x);
    const double beside = (double)(random_bits(&seed) % 2000U) * 1e-6 - 1e-3;
    const double applied = i % 5 == 0 ? -0.8 * solved : solved + beside;
    const int32_t current = (int32_t)(applied * (double)ANHYST_Q30_ONE);
    const int32_t came = cells_flux_for_current(&c, current);
    commit_step(&c);
    const double m_and_air = follow_field(as_number(c.memory.cells.x));
    keep_largest(&worst, fabs(m_and_air - as_number(came)));
    keep_largest(&worst, fabs(arm * m_and_air + field_arm * as_number(c.memory.cells.x) - applied));
    flux = came;
  }
  CHECK_BELOW("flux and current", worst, OFF);
}

/* If the current is within its limits, the flux is the demanded flux. */
static void unreachable_flux_gives_a_current_limit(void)
{
  const anhyst_arms arms = {0, 12000, 16000};
  const double arm = 12000.0 / 65536.0;
  const double field_arm = 16000.0 / 65536.0;
  const double low = -4000.0 / 32768.0;
  const double high = 5000.0 / 32768.0;
  anhyst_compensator c = demagnetised();
  uint64_t seed = 7;
  double worst = 0.0;
  int at_once = 0;
  c.arms = arms;
  words[ANHYST_WORD_CURRENT_LOW] = -4000;
  words[ANHYST_WORD_CURRENT_HIGH] = 5000;
  for (int i = 0; i < STEPS; i++) {
    const double flux = as_number(next_flux(c.flux, &seed));
    const double x = as_number(solve_field_for(&c, (int32_t)(flux * (double)ANHYST_Q30_ONE)));
    const double solved = arm * flux + field_arm * x;
    const double current = fmin(fmax(solved, low), high);
    at_once += fabs(x) > 0.999;
    c.flux_applied = cells_flux_for_current(&c, (int32_t)(current * (double)ANHYST_Q30_ONE));
    commit_step(&c);
    const double m_and_air = follow_field(as_number(c.memory.cells.x));
    keep_largest(&worst, fabs(arm * m_and_air + field_arm * as_number(c.memory.cells.x) - current));
    keep_largest(&worst, current < solved   ? m_and_air - flux
                         : current > solved ? flux - m_and_air
                                            : fabs(flux - m_and_air));
  }
  words[ANHYST_WORD_CURRENT_LOW] = -ANHYST_Q15_MAX;
  words[ANHYST_WORD_CURRENT_HIGH] = ANHYST_Q15_MAX;
  CHECK_BELOW("current, flux", worst, OFF);
  CHECK(at_once > STEPS / 8);
}

static void demagnetising_resets_the_plays(void)
{
  anhyst_compensator c = demagnetised();
  int32_t fields[2];
  for (int i = 0; i < 2; i++) {
    anhyst_compensator_demagnetise(&c);
    fields[i] = solve_field_for(&c, ANHYST_Q30_ONE / 8);
    for (int way = 0; way < 2; way++) {
      c.stage = ANHYST_STAGE_UNKNOWN;
      (void)solve_field_for(&c, ANHYST_Q30_ONE / (way == 0 ? 2 : -4));
      commit_step(&c);
    }
  }
  CHECK(c.plays[0] != 0);
  CHECK(fields[0] == fields[1]);
}

int main(void)
{
  fill_cell_words();
  solved_field_gives_the_demanded_flux();
  current_gives_a_consistent_state();
  unreachable_flux_gives_a_current_limit();
  demagnetising_resets_the_plays();
  return verdict();
}
