/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of solid iron in fixed point, f32 and f64 together: the formats agree while the demand
   moves, the current of a constant demand becomes constant, and damaged states do no harm. */
#include "cell_law_formats.h"
#include "check.h"
#include "truth.h"

enum { STEPS = 20000, RESTING = 20000 };

/* An iron with this number of layers, whose fields differ by 0.3*2^shift for a flux of 1 a tick. */
static void fill_block(int layers, int shift, int laminated)
{
  fill_cell_words();
  words[ANHYST_WORD_LENGTH] = 1024;
  words[ANHYST_WORD_SOLID_LAYERS] = (int16_t)layers;
  words[ANHYST_WORD_SOLID_HOLD] = 20000;
  words[ANHYST_WORD_SOLID_HOLD_SHIFT] = (int16_t)shift;
  words[ANHYST_WORD_SOLID_OWN] = -200;
  words[ANHYST_WORD_SOLID_SURFACE] = 8192;
  words[ANHYST_WORD_SOLID_SECOND] = (int16_t)(layers > 2 ? 9000 : 0);
  words[ANHYST_WORD_SOLID_THIRD] = (int16_t)(layers > 3 ? 9500 : 0);
  words[ANHYST_WORD_SOLID_LAMINATED] = (int16_t)laminated;
  fill_real_words();
  fixed_start();
  f32_start();
  f64_start();
}

/* The gap changes the coefficients, and two thirds of the solved currents are applied rounded. */
static void formats_agree_while_the_demand_moves(double slow, double fast)
{
  uint64_t seed = 3;
  double worst[4] = {0.0, 0.0, 0.0, 0.0};
  for (int i = 0; i < STEPS; i++) {
    const double wanted = rounded(0.55 * sin(slow * i) + 0.15 * sin(fast * i));
    flux_arm = 12000 - (int)(random_bits(&seed) % 10U);
    const double x = f64_field(wanted);
    keep_largest(&worst[0], fabs(fixed_field(wanted) - x));
    keep_largest(&worst[1], fabs(f32_field(wanted) - x));
    if (i % 3 != 0) {
      const double current = rounded(double_of(flux_arm) * wanted + double_of(field_arm) * x);
      const double flux = f64_flux(current);
      keep_largest(&worst[2], fabs(fixed_flux(current) - flux));
      keep_largest(&worst[3], fabs(f32_flux(current) - flux));
    }
    fixed_keep();
    f32_keep();
    f64_keep();
  }
  CHECK_BELOW("field, fixed point", worst[0], 5e-4);
  CHECK_BELOW("field, f32", worst[1], 4e-4);
  CHECK_BELOW("flux, fixed point", worst[2], 2e-4);
  CHECK_BELOW("flux, f32", worst[3], 1e-4);
}

/* An outstanding residual, which is carried from tick to tick, reaches zero. */
static void constant_demand_gives_a_constant_current(const format *law, int descends)
{
  double last = 0.0;
  double moved = 0.0;
  flux_arm = 12000;
  approach_demand(law, 0.5, descends);
  for (int i = 0; i < RESTING; i++) {
    const double current = tick(law, 0.5, 0);
    if (i > RESTING / 2) {
      keep_largest(&moved, fabs(current - last));
    } else {
      last = current;
    }
  }
  printf("%s: ", law->name);
  CHECK_BELOW("current at rest", moved, 5e-6);
}

/* Fields and fluxes stay in their range. No word outside the block is read, as sanitizers check. */
static void damage_does_no_harm(void)
{
  uint64_t seed = 77;
  double most = 0.0;
  for (int i = 0; i < STEPS; i++) {
    const double flux = uniform(&seed, -0.9, 0.9);
    const double current = i % 5 == 0 ? (double)NAN : uniform(&seed, -0.3, 0.3);
    (void)fixed_field(flux);
    (void)f32_field(flux);
    (void)f64_field(flux);
    damage_word(&fixed.memory, sizeof fixed.memory + sizeof fixed.plays + sizeof fixed.next, &seed);
    damage_word(&f32.memory, sizeof f32.memory + sizeof f32.plays + sizeof f32.next, &seed);
    damage_word(&f64.memory, sizeof f64.memory + sizeof f64.plays + sizeof f64.next, &seed);
    damage_word(fixed.deeper, sizeof fixed.deeper, &seed);
    damage_word(f32.deeper, sizeof f32.deeper, &seed);
    damage_word(f64.deeper, sizeof f64.deeper, &seed);
    (void)fixed_flux(i % 5 == 0 ? 0.9 : current);
    keep_largest(&most, fabs(f32_flux(current)));
    keep_largest(&most, fabs(f64_flux(current)));
    fixed_keep();
    f32_keep();
    f64_keep();
    keep_largest(&most, fabs(f32_field(flux)));
    keep_largest(&most, fabs(f64_field(flux)));
  }
  CHECK_BELOW("field, flux", most, 8.0);
}

int main(void)
{
  for (int layers = 2; layers <= 4; layers++) {
    for (int laminated = 0; laminated <= 20000; laminated += 10000) {
      fill_block(layers, 3, laminated);
      formats_agree_while_the_demand_moves(0.001, 0.0173);
      fill_block(layers, 0, laminated);
      formats_agree_while_the_demand_moves(0.02, 0.173);
    }
    for (int law = 0; law < 6; law++) {
      constant_demand_gives_a_constant_current(&FORMATS[law / 2], law % 2);
    }
    damage_does_no_harm();
  }
  return verdict();
}
