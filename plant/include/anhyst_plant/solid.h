/* SPDX-License-Identifier: Apache-2.0 */
/* Solid iron in the path of a magnet, in series with sheets of the same steel: a slab that the
   field enters at its surface, cut into volumes. Each has a share of the section, a field and a
   memory of its own; S_j flows in volume j and deeper. A change of it drives currents between that
   volume and the one outside it, which hold the field back:

     H_(j-1) = H_j + drag_j*dS_j/dt,   H_0 = H_1 outside the first, at the surface
     a*(part*H_surface + (1 - part)*H_sheets(S_1)) + b*S_1 = r

   by the implicit Euler rule: whatever the steps, no path gives back more energy than it took.
   Every left side rises with the fluxes, so they are where a convex function is least. */
#ifndef ANHYST_PLANT_SOLID_H
#define ANHYST_PLANT_SOLID_H

#include "anhyst_plant/iron.h"

#define ANHYST_PLANT_VOLUMES 16

typedef struct {
  int volumes;                        /* >= 1 */
  double part;                        /* of the path that is solid, 0 < part <= 1 */
  double share[ANHYST_PLANT_VOLUMES]; /* of the section, the surface first; their sum is 1 */
  double drag[ANHYST_PLANT_VOLUMES];  /* outside each volume, A s/(m T) */
} anhyst_plant_solid;

/* What is asked of the whole path: a*H + b*B = r, and 1/s of the step, 0 for one without an end. */
typedef struct {
  double a;
  double b;
  double r;
  double per_second;
} anhyst_plant_asked;

/* Where a step leads. */
typedef struct {
  double at[ANHYST_PLANT_VOLUMES]; /* coordinate of each volume, A/m */
  anhyst_plant_goal sheets;
  double field;   /* mean over the path, A/m */
  double density; /* mean over the section, T */
} anhyst_plant_soaked;

/* Neither memory is touched: those of the volumes, the surface first, and that of the sheets. */
void anhyst_plant_soak(const anhyst_plant_iron *iron, const anhyst_plant_solid *solid,
                       const anhyst_plant_memory *volume, const anhyst_plant_memory *sheets,
                       const anhyst_plant_asked *asked, anhyst_plant_soaked *found);

/* Moves there. */
void anhyst_plant_soaked_move(const anhyst_plant_iron *iron, const anhyst_plant_solid *solid,
                              anhyst_plant_memory *volume, anhyst_plant_memory *sheets,
                              const anhyst_plant_soaked *found);

#endif
