/* SPDX-License-Identifier: Apache-2.0 */
/* The curve of a steel that nothing pins:

     J = sharp*h/sqrt(h^2 + knee_sharp^2) + slow*2/pi*atan(h/knee_slow) */
#ifndef ANHYST_PLANT_CURVE_H
#define ANHYST_PLANT_CURVE_H

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  double sharp;      /* T */
  double knee_sharp; /* A/m */
  double slow;       /* T */
  double knee_slow;  /* A/m */
} anhyst_plant_curve;

/* Polarisation at a field, T, and its derivative by the field. */
double anhyst_plant_polarisation(const anhyst_plant_curve *curve, double h, double *slope);

#ifdef __cplusplus
}
#endif
#endif
