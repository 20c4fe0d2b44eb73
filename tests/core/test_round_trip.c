/* SPDX-License-Identifier: Apache-2.0 */
/* Forward and inverse solutions undo each other, for thousands of sets at 12 samples per loop. The
   limit is the resolution of double precision, in units of the last place (ulp) of H_max +
   B_max/mu0, because a rounded flux density contains no more information about the field. Most sets
   stay below 20 ulp. If M is constant and M_s/a is 1e6, the rounding of y is amplified a
   thousandfold. For the extreme sets, this is the only claim: with B_max/mu0 = 1e7*H_max, B itself
   has no digits left. */
#include <float.h>
#include <string.h>

#include "check.h"
#include "laws.h"

#define SAMPLES 24

static const double most_units = 4000.0; /* in single precision: 5e-4 of H_max + B_max/mu0 */

static sample_iron sample;

typedef struct {
  double field; /* largest |H - H'| divided by H_max */
  double units; /* the same error in ulp of H_max + B_max/mu0 */
  double state;
  int sets, jumping, saturated;
} outcome;

static void sum_drive_terms(uint64_t *seed, double drive[SAMPLES])
{
  const int wandering = random_bits(seed) % 2 == 0;
  for (int i = 0; i < SAMPLES; i++) {
    const double sine = sin(2.0 * 3.14159265358979 * (double)(i + 1) / 12.0);
    const double path_errors = uniform(seed, -1.0, 1.0) * uniform(seed, 0.0, 1.0);
    drive[i] = sample.amplitude * (wandering ? path_errors : sine);
  }
}

static void forward_and_inverse(uint64_t *seed, double rho, double eddy, outcome *out)
{
  anhyst_memory_f64 there;
  anhyst_memory_f64 back;
  memset(&there, 0, sizeof there);
  memset(&back, 0, sizeof back);
  double drive[SAMPLES];
  double flux[SAMPLES];
  double again[SAMPLES];
  double field[SAMPLES];
  double gap_ratio[SAMPLES];
  double eddies[SAMPLES];
  size_t index = 0;
  sum_drive_terms(seed, drive);
  for (int i = 0; i < SAMPLES; i++) {
    gap_ratio[i] = rho * (1.0 + 0.4 * sin((double)i));
    eddies[i] = eddy;
  }
  const anhyst_status forward = anhyst_record_f64(&sample.iron, &there, 0, SAMPLES, drive,
                                                  gap_ratio, eddies, flux, field, &index);
  const anhyst_status inverse = anhyst_record_f64(&sample.iron, &back, 1, SAMPLES, flux, gap_ratio,
                                                  eddies, again, field, &index);
  CHECK(forward == ANHYST_OK && inverse == ANHYST_OK);
  if (forward != ANHYST_OK || inverse != ANHYST_OK) {
    return;
  }
  double largest = 0.0;
  double worst = 0.0;
  double most_flux = 0.0;
  for (int i = 0; i < SAMPLES; i++) {
    keep_largest(&largest, fabs(drive[i]));
    keep_largest(&most_flux, fabs(flux[i]));
    keep_largest(&worst, fabs(again[i] - drive[i]));
  }
  /* Returns the sum of all terms of the drive: field, gap and eddy currents. */
  const double terms = largest + most_flux * (1.0 / ANHYST_MU0 * (1.0 + rho) + eddy);
  keep_largest(&out->field, worst / largest);
  keep_largest(&out->units, worst / terms / DBL_EPSILON);
  keep_largest(&out->state, fabs(there.lag.y - back.lag.y));
  out->sets++;
  out->jumping += sample.iron.interaction * sample.iron.saturation > 3.0 * sample.iron.shape;
  out->saturated += most_flux > 0.9 * ANHYST_MU0 * sample.iron.saturation;
}

static void inverse_of_forward_returns_the_field(anhyst_step step, int what, int count)
{
  uint64_t seed = 100 + (uint64_t)step + 10 * (uint64_t)what;
  outcome out;
  memset(&out, 0, sizeof out);
  for (int i = 0; i < count; i++) {
    if (make_random_iron(&seed, step, what, &sample)) {
      forward_and_inverse(&seed, 0.0, 0.0, &out);
    }
  }
  printf("step %d, options %d: %d sets, %d jump, %d saturate\n", (int)step, what, out.sets,
         out.jumping, out.saturated);
  CHECK(out.sets > count / 5);
  if ((what & EXTREME) == 0) {
    CHECK_BELOW("  field, over H_max", out.field, 1e-9);
    CHECK_BELOW("  y afterwards", out.state, 1e-9);
  }
  CHECK_BELOW("  field, in last places of H_max + B_max/mu0", out.units, most_units);
}

static void moving_gap_and_eddy_currents_are_inverted(anhyst_step step, int count)
{
  uint64_t seed = 200 + (uint64_t)step;
  outcome out;
  memset(&out, 0, sizeof out);
  for (int i = 0; i < count; i++) {
    if (make_random_iron(&seed, step, WITH_PLAY, &sample)) {
      const double rho = log_uniform(&seed, 1e-4, 0.1);
      const double eddy = log_uniform(&seed, 1e-5, 0.1) / ANHYST_MU0;
      sample.amplitude *= 1.0 + sample.iron.saturation / sample.amplitude * rho;
      forward_and_inverse(&seed, rho, eddy, &out);
    }
  }
  printf("step %d, moving gap: %d sets\n", (int)step, out.sets);
  CHECK_BELOW("  drive, over its largest", out.field, 1e-9);
  CHECK_BELOW("  drive, in last places of its terms", out.units, most_units);
}

int main(void)
{
  const int many[] = {4000, 4000, 120};
  for (int i = 0; i < 3; i++) {
    const anhyst_step step = (anhyst_step)i;
    inverse_of_forward_returns_the_field(step, 0, many[i]);
    inverse_of_forward_returns_the_field(step, MAY_JUMP, many[i] / 2);
    inverse_of_forward_returns_the_field(step, WITH_PLAY, many[i] / 2);
    if (step != ANHYST_STEP_JA1986) {
      inverse_of_forward_returns_the_field(step, EXTREME, many[i] / 2);
      inverse_of_forward_returns_the_field(step, EXTREME | MAY_JUMP | WITH_PLAY, many[i] / 2);
    }
    moving_gap_and_eddy_currents_are_inverted(step, many[i] / 4);
  }
  return verdict();
}
