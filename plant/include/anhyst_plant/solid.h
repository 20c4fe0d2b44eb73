/* SPDX-License-Identifier: Apache-2.0 */
/* Solid iron in the flux path of a magnet, in series with laminations of the same steel: a slab
   that the field enters at its surface, divided into volumes. Each volume has a share of the
   cross-section, a field and a memory. S_j is the flux in volume j and all deeper volumes. A change
   of S_j drives eddy currents between volume j and the volume outside it, which oppose the field:

        H_(j-1) = H_j + drag_j*dS_j/dt,   H_0: field at the surface
        a*(part*H_surface + (1 - part)*H_sheets(S_1)) + b*S_1 = r

   The time derivative uses the implicit Euler rule. For any steps, no path returns more energy than
   it has taken up. Every left side rises with the fluxes. Therefore, the solution is the minimum of
   a convex function. */
#ifndef ANHYST_PLANT_SOLID_H
#define ANHYST_PLANT_SOLID_H

#include "anhyst_plant/iron.h"

#define ANHYST_PLANT_MAX_VOLUMES 16

typedef struct {
  int volumes;                            /* >= 1 */
  double part;                            /* solid fraction of the path, 0 < part <= 1 */
  double share[ANHYST_PLANT_MAX_VOLUMES]; /* shares of the cross-section, surface first; sum 1 */
  double drag[ANHYST_PLANT_MAX_VOLUMES];  /* eddy-current drag of each volume, A s/(m T) */
} anhyst_plant_solid;

/* Equation of the whole path: a*H + b*B = r. per_second: reciprocal of the time step,
   1/s; 0: the step is infinitely long. */
typedef struct {
  double a;
  double b;
  double r;
  double per_second;
} anhyst_plant_asked;

/* Result of a step. */
typedef struct {
  double at[ANHYST_PLANT_MAX_VOLUMES]; /* coordinate of each volume, A/m */
  anhyst_plant_goal sheets;
  double field;   /* mean field over the path, A/m */
  double density; /* mean flux density over the cross-section, T */
} anhyst_plant_soaked;

/* Solves a step. Does not change the memories of volumes (surface first) and laminations. */
void anhyst_plant_soak(const anhyst_plant_iron *iron, const anhyst_plant_solid *solid,
                       const anhyst_plant_memory *volume, const anhyst_plant_memory *sheets,
                       const anhyst_plant_asked *asked, anhyst_plant_soaked *found);

/* Moves the memories to the result. */
void anhyst_plant_soaked_move(const anhyst_plant_iron *iron, const anhyst_plant_solid *solid,
                              anhyst_plant_memory *volume, anhyst_plant_memory *sheets,
                              const anhyst_plant_soaked *found);

#endif
