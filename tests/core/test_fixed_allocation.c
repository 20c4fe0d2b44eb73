/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the allocation of a net force to a pair of drives in fixed point. */
#include "anhyst/control/allocation.h"

#include "anhyst/control/allocation_real.h"
#include "anhyst/numeric/fixed.h"
#include "check.h"
#include "edges.h"
#include "maps.h"

#define ONE 2147483648.0

/* Returns the larger error of the two forces, LSB; 0 if the larger force saturates. */
static double error_of_class_ab(int32_t net, int32_t idle)
{
  const anhyst_allocation_q31 fixed = {idle, ANHYST_ALLOCATE_CLASS_AB};
  const anhyst_allocation_f64 real = {idle, ANHYST_ALLOCATE_CLASS_AB};
  int32_t found[2];
  double exact[2];
  anhyst_allocate_q31(&fixed, net, found);
  anhyst_allocate_f64(&real, net, exact);
  CHECK(found[0] >= 0 && found[1] >= 0);
  const int along = net >= 0 ? 0 : 1;
  if (exact[along] >= ONE - 1.0) {
    CHECK(found[along] > ANHYST_Q31_MAX - ANHYST_ALLOCATION_ERROR);
    return 0.0;
  }
  return fmax(fabs(found[0] - exact[0]), fabs(found[1] - exact[1]));
}

static void class_ab_allocation_matches_exact_arithmetic(void)
{
  double worst = 0.0;
  for (int i = 0; i < EDGE_COUNT; i++) {
    for (int j = 0; j < EDGE_COUNT; j++) {
      if (edge_number(j) > 0) {
        keep_largest(&worst, error_of_class_ab(edge_number(i), edge_number(j)));
      }
    }
  }
  for (int i = 0; i < 400000; i++) {
    const int32_t net = any_code() >> any_within(0, 30);
    const int32_t idle = (any_code() & 0x7FFFFFFF) >> any_within(0, 30);
    keep_largest(&worst, error_of_class_ab(net, idle > 0 ? idle : 1));
  }
  CHECK_BELOW("units in the last place of a force", worst, ANHYST_ALLOCATION_ERROR);
}

static void class_a_pair_and_single_drive_give_the_net_force(void)
{
  for (int i = 0; i < 10000; i++) {
    const int32_t net = any_code() / 2;
    const int32_t idle = any_within(1, ANHYST_Q30_ONE);
    const anhyst_allocation_q31 halves = {idle, ANHYST_ALLOCATE_BY_HALVES};
    const anhyst_allocation_q31 single = {0, ANHYST_ALLOCATE_SINGLE};
    int32_t force[2];
    anhyst_allocate_q31(&halves, net, force);
    CHECK(force[0] - force[1] == 2 * (net >> 1) && force[0] + (force[1] - idle) == idle);
    anhyst_allocate_q31(&single, net, force);
    CHECK(force[0] == net);
  }
}

int main(void)
{
  class_ab_allocation_matches_exact_arithmetic();
  class_a_pair_and_single_drive_give_the_net_force();
  return verdict();
}
