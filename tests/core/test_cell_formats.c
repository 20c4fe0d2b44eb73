/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the play-cell law in fixed point, f32 and f64 together: the formats agree on random
   paths, none of them drifts at rest, and damaged states and signals do no harm. */
#include "cell_law_formats.h"
#include "check.h"
#include "truth.h"

enum { STEPS = 100000, RESTING = 200000 };

static void fill_block(void)
{
  fill_cell_words();
  fill_real_words();
}

/* The gap changes the coefficients. A third of the currents is rounded to a converter of 12 bits,
   and sometimes another current is applied. */
static void formats_agree_on_random_paths(void)
{
  uint64_t seed = 3;
  double flux = 0.0;
  double field_error[2] = {0.0, 0.0};
  double flux_error[2] = {0.0, 0.0};
  fixed_start();
  f32_start();
  f64_start();
  for (int i = 0; i < STEPS; i++) {
    flux = next_flux(flux, 0.85, &seed);
    flux_arm = 12000 - (int)(random_bits(&seed) % 1000U);
    field_arm = 16000 + (int)(random_bits(&seed) % 1000U);
    const double x = f64_field(flux);
    keep_largest(&field_error[0], fabs(fixed_field(flux) - x));
    keep_largest(&field_error[1], fabs(f32_field(flux) - x));
    double current = double_of(flux_arm) * flux + double_of(field_arm) * x;
    current = i % 3 == 0 ? floor(current * 4096.0) / 4096.0 : rounded(current);
    current = i % 17 == 0 ? rounded(uniform(&seed, -0.3, 0.3)) : current;
    if (i % 3 != 1) {
      flux = f64_flux(current);
      keep_largest(&flux_error[0], fabs(fixed_flux(current) - flux));
      keep_largest(&flux_error[1], fabs(f32_flux(current) - flux));
    }
    fixed_keep();
    f32_keep();
    f64_keep();
  }
  CHECK_BELOW("field, fixed point", field_error[0], 1e-4);
  CHECK_BELOW("field, f32", field_error[1], 1e-4);
  CHECK_BELOW("flux, fixed point", flux_error[0], 4e-5);
  CHECK_BELOW("flux, f32", flux_error[1], 4e-5);
}

/* Noise of demand and gap widens the range of the path only in its first ticks. */
static void no_format_drifts_at_rest(const format *law)
{
  const double flux = 0.5;
  double drift = 0.0;
  for (int way = 0; way < 4; way++) {
    uint64_t seed = 9;
    double first = 0.0;
    approach_demand(law, flux, way / 2);
    for (int i = 0; i <= RESTING; i++) {
      flux_arm = 12000 - (int)(random_bits(&seed) % 4U);
      (void)tick(law, rounded(flux + uniform(&seed, -1.3e-4, 1.3e-4)), way % 2);
      if (i == RESTING / 4 || i == RESTING) {
        flux_arm = 12000;
        const double current = tick(law, flux, way % 2);
        keep_largest(&drift, i == RESTING ? fabs(current - first) : 0.0);
        first = current;
      }
    }
  }
  printf("%s: ", law->name);
  CHECK_BELOW("drift of the current at rest", drift, 1e-6);
}

/* Returns whether a constant demand leaves the state unchanged from the second tick on. */
static void constant_demand_reverses_no_path(void)
{
  uint64_t seed = 21;
  int changes = 0;
  fixed_start();
  f32_start();
  f64_start();
  for (int i = 0; i < STEPS / 10; i++) {
    const double flux = next_flux(fixed.flux / 1073741824.0, 0.85, &seed);
    for (int law = 0; law < 3; law++) {
      (void)tick(&FORMATS[law], flux, 0);
    }
    const anhyst_cells_memory memory = fixed.memory.cells;
    const anhyst_cells_memory_f32 memory_f32 = f32.memory.cells;
    const anhyst_cells_memory_f64 memory_f64 = f64.memory.cells;
    for (int more = 0; more < 9; more++) {
      (void)tick(&FORMATS[more % 3], flux, 0);
    }
    changes += fixed.memory.cells.x != memory.x || fixed.memory.cells.active != memory.active ||
               f32.memory.cells.x < memory_f32.x || f32.memory.cells.x > memory_f32.x ||
               f32.memory.cells.active != memory_f32.active || f64.memory.cells.x < memory_f64.x ||
               f64.memory.cells.x > memory_f64.x || f64.memory.cells.active != memory_f64.active;
  }
  CHECK(changes == 0);
}

/* Fields and fluxes stay finite and in their range. No word outside the block is read, as
   sanitizers check. */
static void damaged_words_and_nan_signals_do_no_harm(void)
{
  const double odd[4] = {(double)NAN, (double)INFINITY, -(double)INFINITY, 1e30};
  uint64_t seed = 77;
  double most = 0.0;
  fixed_start();
  f32_start();
  f64_start();
  for (int i = 0; i < STEPS; i++) {
    const uint64_t choice = random_bits(&seed);
    const double flux = uniform(&seed, -0.9, 0.9);
    const double current = choice % 5U == 0U ? odd[choice / 5U % 4U] : uniform(&seed, -0.3, 0.3);
    (void)fixed_field(flux);
    (void)f32_field(flux);
    (void)f64_field(flux);
    damage_word(&fixed.memory, sizeof fixed.memory + sizeof fixed.plays + sizeof fixed.next, &seed);
    damage_word(&f32.memory, sizeof f32.memory + sizeof f32.plays + sizeof f32.next, &seed);
    damage_word(&f64.memory, sizeof f64.memory + sizeof f64.plays + sizeof f64.next, &seed);
    (void)fixed_flux(choice % 5U == 0U ? 0.9 : current);
    keep_largest(&most, fabs(f32_flux(current)));
    keep_largest(&most, fabs(f64_flux(current)));
    fixed_keep();
    f32_keep();
    f64_keep();
    f32.stage = f64.stage = fixed.stage = (uint16_t)(choice / 64U % 3U);
    keep_largest(&most, fabs(f32_field(flux)));
    keep_largest(&most, fabs(f64_field(flux)));
    keep_largest(&most, fabs(f32_flux(0.1)));
    keep_largest(&most, fabs(f64_flux(0.1)));
  }
  CHECK_BELOW("field, flux", most, 4.0);
}

int main(void)
{
  fill_block();
  formats_agree_on_random_paths();
  for (int law = 0; law < 3; law++) {
    no_format_drifts_at_rest(&FORMATS[law]);
  }
  constant_demand_reverses_no_path();
  damaged_words_and_nan_signals_do_no_harm();
  return verdict();
}
