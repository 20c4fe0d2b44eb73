/* SPDX-License-Identifier: Apache-2.0 */

/* E = 1 - exp(-s), G = 1 - E/s and dG/ds: the weights of the linear step, smooth at s = 0. */
typedef struct {
  ANHYST_REAL e, g, g_slope;
} ANHYST_NAME(weights);

static ANHYST_NAME(weights) ANHYST_NAME(weights_at)(ANHYST_REAL s)
{
  ANHYST_NAME(weights) w;
  const ANHYST_REAL kept = ANHYST_EXP(-s);
  if (s < R(0.3)) {
    /* Series: the closed forms lose digits as s^-2. */
    w.g =
        s *
        (R(1.0) / R(2.0) -
         s * (R(1.0) / R(6.0) -
              s * (R(1.0) / R(24.0) -
                   s * (R(1.0) / R(120.0) -
                        s * (R(1.0) / R(720.0) -
                             s * (R(1.0) / R(5040.0) -
                                  s * (R(1.0) / R(40320.0) -
                                       s * (R(1.0) / R(362880.0) -
                                            s * (R(1.0) / R(3628800.0) - s / R(39916800.0))))))))));
    w.e = s * (R(1.0) - w.g);
    w.g_slope =
        R(1.0) / R(2.0) -
        s * (R(1.0) / R(3.0) -
             s * (R(1.0) / R(8.0) -
                  s * (R(1.0) / R(30.0) -
                       s * (R(1.0) / R(144.0) -
                            s * (R(1.0) / R(840.0) -
                                 s * (R(1.0) / R(5760.0) -
                                      s * (R(1.0) / R(45360.0) -
                                           s * (R(1.0) / R(403200.0) - s / R(3991680.0)))))))));
    return w;
  }
  w.e = R(1.0) - kept;
  w.g = R(1.0) - w.e / s;
  w.g_slope = (w.e / s - kept) / s;
  return w;
}
