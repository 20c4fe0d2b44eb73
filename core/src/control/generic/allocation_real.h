/* SPDX-License-Identifier: Apache-2.0 */

static int is_force_valid(ANHYST_REAL a) { return a > R(0.0) && a <= R(1e30); }
static ANHYST_REAL half(ANHYST_REAL a) { return R(0.5) * a; }

static ANHYST_REAL larger_force(ANHYST_REAL net, ANHYST_REAL idle)
{
  return ANHYST_SQRT(R(0.25) * net * net + idle * idle) + R(0.5) * ANHYST_FABS(net);
}

static ANHYST_REAL smaller_force(ANHYST_REAL larger, ANHYST_REAL idle)
{
  return idle * idle / larger;
}
