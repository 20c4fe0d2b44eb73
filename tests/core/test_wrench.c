/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the allocation of a wrench to drives in any position and direction. */
#include "anhyst/control/wrench.h"
#include "check.h"
#include "maps.h"

static double pull[ANHYST_WRENCH_DRIVES * ANHYST_WRENCH_AXES];
static uint16_t against[ANHYST_WRENCH_DRIVES];
static anhyst_wrench_f64 drives;
static const double yields[ANHYST_WRENCH_AXES] = {1e-1, 1e-2, 1e-4, 1e-4, 1e-4, 1e-3};
static const float narrow_yields[ANHYST_WRENCH_AXES] = {1e-1F, 1e-2F, 1e-4F, 1e-4F, 1e-4F, 1e-3F};

static double any_part(void) { return (double)any_within(-1000000, 1000000) / 1e6; }

/* Returns drives in any position and direction. Of more than two, the first two are a pair. */
static anhyst_wrench_layout_f64 any_layout(void)
{
  const anhyst_wrench_layout_f64 layout = {(uint16_t)any_within(1, ANHYST_WRENCH_AXES),
                                           (uint16_t)any_within(1, ANHYST_WRENCH_DRIVES),
                                           pull,
                                           against,
                                           {5.0, ANHYST_ALLOCATE_CLASS_AB},
                                           0.5,
                                           240.0,
                                           yields};
  for (int j = 0; j < (int)layout.drives; j++) {
    against[j] = (uint16_t)j;
    for (int k = 0; k < (int)layout.axes; k++) {
      pull[j * layout.axes + k] = any_part();
    }
  }
  if (layout.drives > 2U) {
    against[0] = 1;
    against[1] = 0;
    for (int k = 0; k < (int)layout.axes; k++) {
      pull[layout.axes + k] = -pull[k];
    }
  }
  return layout;
}

static double residual(const anhyst_wrench_layout_f64 *layout, const double *wrench,
                       const double *force)
{
  double worst = 0.0;
  double size = 1.0;
  for (int j = 0; j < (int)layout->drives; j++) {
    keep_largest(&size, fabs(force[j]));
  }
  for (int k = 0; k < (int)layout->axes; k++) {
    double sum = -wrench[k];
    for (int j = 0; j < (int)layout->drives; j++) {
      sum += pull[j * layout->axes + k] * force[j];
    }
    keep_largest(&worst, fabs(sum));
  }
  return worst / size;
}

static void reported_wrench_is_produced_and_drives_only_pull(void)
{
  double worst = 0.0;
  int made = 0;
  for (int i = 0; i < 200000; i++) {
    const anhyst_wrench_layout_f64 layout = any_layout();
    double wrench[ANHYST_WRENCH_AXES] = {0};
    double force[ANHYST_WRENCH_DRIVES];
    if (anhyst_wrench_init_f64(&drives, &layout) != ANHYST_OK) {
      continue;
    }
    for (int k = 0; k < (int)layout.axes; k++) {
      wrench[k] = 100.0 * any_part();
    }
    if (anhyst_wrench_share_f64(&drives, wrench, force)) {
      keep_largest(&worst, residual(&layout, wrench, force));
      made++;
    }
    for (int j = 0; j < (int)layout.drives; j++) {
      CHECK(force[j] > 0.0 && (against[j] != j || force[j] >= 0.5 * (1.0 - 1e-9)));
    }
  }
  CHECK(made > 20000);
  CHECK_BELOW("residual, of the largest force", worst, 1e-9);
}

/* Returns a layout with all numbers rounded to single precision. */
static anhyst_wrench_layout_f32 round_layout(const anhyst_wrench_layout_f64 *layout)
{
  static float narrow[ANHYST_WRENCH_DRIVES * ANHYST_WRENCH_AXES];
  const anhyst_wrench_layout_f32 found = {
      layout->axes, layout->drives, narrow,       against, {5.0F, ANHYST_ALLOCATE_CLASS_AB},
      0.5F,         240.0F,         narrow_yields};
  for (int i = 0; i < (int)layout->drives * (int)layout->axes; i++) {
    narrow[i] = (float)pull[i];
  }
  return found;
}

static void single_precision_gives_the_same_wrenches(void)
{
  double worst = 0.0;
  int made = 0;
  for (int i = 0; i < 100000; i++) {
    const anhyst_wrench_layout_f64 wide = any_layout();
    const anhyst_wrench_layout_f32 layout = round_layout(&wide);
    anhyst_wrench_f32 narrow;
    float wrench[ANHYST_WRENCH_AXES] = {0};
    double wanted[ANHYST_WRENCH_AXES] = {0};
    float force[ANHYST_WRENCH_DRIVES];
    double found[ANHYST_WRENCH_DRIVES] = {0};
    if (anhyst_wrench_init_f32(&narrow, &layout) != ANHYST_OK) {
      continue;
    }
    for (int k = 0; k < (int)layout.axes; k++) {
      wrench[k] = (float)(100.0 * any_part());
      wanted[k] = (double)wrench[k];
    }
    const int is_made = anhyst_wrench_share_f32(&narrow, wrench, force);
    for (int j = 0; j < (int)layout.drives; j++) {
      CHECK(force[j] > 0.0F && (against[j] != j || force[j] >= 0.5F * (1.0F - 1e-6F)));
      found[j] = (double)force[j];
    }
    if (is_made) {
      keep_largest(&worst, residual(&wide, wanted, found));
      made++;
    }
  }
  CHECK(made > 10000);
  CHECK_BELOW("residual in single precision, of the largest force", worst, 2e-4);
}

static void nan_wrench_gives_no_force(void)
{
  const double wrench[ANHYST_WRENCH_AXES] = {0.0, (double)NAN, (double)INFINITY, 0.0, 0.0, 0.0};
  double force[ANHYST_WRENCH_DRIVES];
  int tried = 0;
  for (int i = 0; i < 1000; i++) {
    const anhyst_wrench_layout_f64 layout = any_layout();
    if (layout.axes > 1U && anhyst_wrench_init_f64(&drives, &layout) == ANHYST_OK) {
      CHECK(!anhyst_wrench_share_f64(&drives, wrench, force));
      tried++;
    }
  }
  CHECK(tried > 100);
}

static void bidirectional_drives_use_least_squares(void)
{
  double worst = 0.0;
  double slope = 0.0;
  int made = 0;
  for (int i = 0; i < 20000; i++) {
    anhyst_wrench_layout_f64 layout = any_layout();
    double wrench[ANHYST_WRENCH_AXES];
    double force[ANHYST_WRENCH_DRIVES];
    double other[ANHYST_WRENCH_DRIVES];
    layout.pair.kind = ANHYST_ALLOCATE_SINGLE;
    layout.pair.idle = 0.0;
    layout.least = -1e9;
    for (int j = 0; j < (int)layout.drives; j++) {
      against[j] = (uint16_t)j;
    }
    if (anhyst_wrench_init_f64(&drives, &layout) != ANHYST_OK) {
      continue;
    }
    for (int k = 0; k < ANHYST_WRENCH_AXES; k++) {
      wrench[k] = 100.0 * any_part();
    }
    CHECK(anhyst_wrench_share_f64(&drives, wrench, force));
    keep_largest(&worst, residual(&layout, wrench, force));
    for (int k = 0; k < ANHYST_WRENCH_AXES; k++) {
      wrench[k] = -wrench[k];
    }
    CHECK(anhyst_wrench_share_f64(&drives, wrench, other));
    for (int j = 0; j < (int)layout.drives; j++) {
      keep_largest(&slope, fabs(force[j] + other[j]) / (1.0 + fabs(force[j])));
    }
    made++;
  }
  CHECK(made > 5000);
  CHECK_BELOW("residual of both signs, of the largest force", worst, 1e-9);
  CHECK_BELOW("difference from the opposite of the opposite wrench", slope, 1e-12);
}

static void bidirectional_drive_stays_at_its_lower_limit_for_nan(void)
{
  const double one[2] = {1.0, 1.0};
  const uint16_t alone[2] = {0, 1};
  const anhyst_wrench_layout_f64 layout = {
      1, 2, one, alone, {0.0, ANHYST_ALLOCATE_SINGLE}, -40.0, 240.0, yields};
  const double push = -60.0;
  const double beyond = -100.0;
  const double none = (double)NAN;
  double force[2];
  CHECK(anhyst_wrench_init_f64(&drives, &layout) == ANHYST_OK);
  CHECK(anhyst_wrench_share_f64(&drives, &push, force));
  CHECK(fabs(force[0] + 30.0) < 1e-9 && fabs(force[1] + 30.0) < 1e-9);
  CHECK(!anhyst_wrench_share_f64(&drives, &beyond, force));
  CHECK(force[0] >= -60.0 && force[1] >= -60.0 && force[0] <= -40.0);
  CHECK(!anhyst_wrench_share_f64(&drives, &none, force));
  CHECK(fabs(force[0]) < 1e-300 && fabs(force[1]) < 1e-300);
}

/* Returns the largest deviation from the forces of new drives with the same losses and the same
   wrench, divided by the largest force. */
static double deviation_from_new_drives(const anhyst_wrench_layout_f64 *layout, const int *lost,
                                        int losses, const double *wrench, const double *force)
{
  static anhyst_wrench_f64 fresh;
  double found[ANHYST_WRENCH_DRIVES];
  double worst = 0.0;
  double size = 1.0;
  CHECK(anhyst_wrench_init_f64(&fresh, layout) == ANHYST_OK);
  for (int i = 0; i < losses; i++) {
    anhyst_wrench_lose_f64(&fresh, lost[i]);
  }
  (void)anhyst_wrench_share_f64(&fresh, wrench, found);
  for (int j = 0; j < (int)layout->drives; j++) {
    keep_largest(&size, fabs(found[j]));
    keep_largest(&worst, fabs(found[j] - force[j]));
  }
  return worst / size;
}

/* Every force is within its bounds, and a lost drive has no force. */
static void check_bounds(const anhyst_wrench_layout_f64 *layout, const double *force)
{
  for (int j = 0; j < (int)layout->drives; j++) {
    const double least = drives.single_drives >> j & 1 ? 0.5 : 0.0;
    CHECK(force[j] >= least * (1.0 - 1e-9) && force[j] < 241.0);
    CHECK(!(drives.lost >> j & 1) || !(force[j] > 0.0));
  }
}

static void reduction_depends_only_on_the_wrench(void)
{
  double worst = 0.0;
  int given_up = 0;
  for (int i = 0; i < 3000; i++) {
    const anhyst_wrench_layout_f64 layout = any_layout();
    double wrench[ANHYST_WRENCH_AXES] = {0};
    double force[ANHYST_WRENCH_DRIVES];
    int lost[3];
    if (anhyst_wrench_init_f64(&drives, &layout) != ANHYST_OK) {
      continue;
    }
    for (int tick = 0; tick < 60; tick++) {
      const double path_errors = tick % 7 == 0 ? 100.0 : 1.0;
      if (tick % 20 == 0) {
        lost[tick / 20] = any_within(0, layout.drives - 1);
        anhyst_wrench_lose_f64(&drives, lost[tick / 20]);
      }
      for (int k = 0; k < (int)layout.axes; k++) {
        wrench[k] += path_errors * any_part();
      }
      given_up += !anhyst_wrench_share_f64(&drives, wrench, force);
      check_bounds(&layout, force);
      keep_largest(&worst, deviation_from_new_drives(&layout, lost, tick / 20 + 1, wrench, force));
    }
  }
  CHECK(given_up > 50000);
  CHECK_BELOW("difference from drives that were asked nothing before, of the force", worst, 1e-9);
}

static void invalid_layouts_are_refused(void)
{
  const double one[2] = {1.0, -1.0};
  const uint16_t alone[2] = {0, 1};
  const uint16_t astray[2] = {1, 1};
  anhyst_wrench_layout_f64 layout = {1,   2,     one,   alone, {5.0, ANHYST_ALLOCATE_CLASS_AB},
                                     0.5, 240.0, yields};
  CHECK(anhyst_wrench_init_f64(&drives, &layout) == ANHYST_OK);
  layout.against = astray;
  CHECK(anhyst_wrench_init_f64(&drives, &layout) == ANHYST_BAD_PARAMETER);
  layout.against = alone;
  layout.least = (double)NAN;
  CHECK(anhyst_wrench_init_f64(&drives, &layout) == ANHYST_BAD_PARAMETER);
  layout.least = 0.5;
  layout.drives = ANHYST_WRENCH_DRIVES + 1;
  CHECK(anhyst_wrench_init_f64(&drives, &layout) == ANHYST_BAD_PARAMETER);
}

int main(void)
{
  reported_wrench_is_produced_and_drives_only_pull();
  single_precision_gives_the_same_wrenches();
  nan_wrench_gives_no_force();
  bidirectional_drives_use_least_squares();
  bidirectional_drive_stays_at_its_lower_limit_for_nan();
  reduction_depends_only_on_the_wrench();
  invalid_layouts_are_refused();
  return verdict();
}
