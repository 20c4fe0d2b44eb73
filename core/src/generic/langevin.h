/* SPDX-License-Identifier: Apache-2.0 */

ANHYST_REAL ANHYST_NAME(anhyst_langevin)(ANHYST_REAL z, ANHYST_REAL *slope)
{
  const ANHYST_REAL size = ANHYST_FABS(z);
  if (size < R(1.5)) {
    const ANHYST_REAL per_z = ANHYST_NAME(langevin_per_z)(z * z);
    const ANHYST_REAL value = z * per_z;
    *slope = R(1.0) - value * value - R(2.0) * per_z;
    return value;
  }
  if (size > R(22.0)) { /* coth is 1 to the last place */
    const ANHYST_REAL per_size = R(1.0) / size;
    *slope = per_size * per_size;
    return z < R(0.0) ? per_size - R(1.0) : R(1.0) - per_size;
  }
  const ANHYST_REAL e = ANHYST_EXP(R(-2.0) * size);
  const ANHYST_REAL inverse = R(1.0) / (size * (R(1.0) - e));
  const ANHYST_REAL per_size = inverse * (R(1.0) - e);
  const ANHYST_REAL per_rest = inverse * size;
  const ANHYST_REAL value = R(1.0) - per_size + R(2.0) * e * per_rest;
  *slope = per_size * per_size - R(4.0) * e * per_rest * per_rest;
  return z < R(0.0) ? -value : value;
}

ANHYST_REAL ANHYST_NAME(anhyst_inverse_langevin)(ANHYST_REAL y)
{
  ANHYST_REAL z = y * (R(3.0) - y * y) / (R(1.0) - y * y);
  for (int i = 0; i < 8; i++) {
    ANHYST_REAL slope;
    const ANHYST_REAL error = ANHYST_NAME(anhyst_langevin)(z, &slope) - y;
    const ANHYST_REAL step = error / slope;
    z -= step;
    if (ANHYST_FABS(step) <= R(4.0) * ANHYST_EPS * ANHYST_FABS(z)) {
      break;
    }
  }
  return z;
}
