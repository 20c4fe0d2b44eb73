/* SPDX-License-Identifier: Apache-2.0 */
/* The working gap of a proportional solenoid: a plunger in front of a stop with a control cone.
   Three ways lie in parallel: the flat face of the plunger, the wall of the cone, into which the
   plunger dips and whose thin end saturates, and leakage that pulls at nothing. At ampere-turns u

     flux(u) = (face + leakage)*u + cone*u/sqrt(1 + (cone*u/limit)^2)

   and the force is what the coenergy gives up, -d/dgap of the integral of flux over u, so that
   force and flux belong to one circuit. */
#ifndef ANHYST_PLANT_CONE_H
#define ANHYST_PLANT_CONE_H

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  double leakage;    /* permeance parallel to the working gap, H */
  double side;       /* of a square as large as the flat face, m */
  double fringe;     /* by which this widens on each side, over the gap */
  double around;     /* circumference of the wall, m */
  double clearance;  /* radial, between plunger and wall, m */
  double depth;      /* gap at which the plunger begins to dip in, m */
  double onset;      /* length over which this beginning is washed out, m */
  double thickness;  /* of the wall at its end, m */
  double taper;      /* how much thicker it is for each metre of depth */
  double saturation; /* flux density at which the wall saturates, T */
} anhyst_plant_cone;

/* At one gap: permeances, H, and what they change by for each metre. */
typedef struct {
  double gap;      /* m */
  double straight; /* of face and leakage together */
  double d_face;
  double cone;
  double d_cone;
  double limit; /* flux that saturates the wall, Wb */
  double d_limit;
} anhyst_plant_cone_gap;

void anhyst_plant_cone_at(const anhyst_plant_cone *cone, double gap, anhyst_plant_cone_gap *at);

/* Ampere-turns that a flux needs, looked for from some near by, A; and their slope over the flux,
   1/H. */
double anhyst_plant_cone_mmf(const anhyst_plant_cone_gap *at, double flux, double near,
                             double *slope);

/* Pull that closes the gap, N. */
double anhyst_plant_cone_force(const anhyst_plant_cone_gap *at, double mmf);

#ifdef __cplusplus
}
#endif
#endif
