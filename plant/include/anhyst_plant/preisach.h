/* SPDX-License-Identifier: Apache-2.0 */
/* A moving Preisach iron: relays with a density over their two switching fields, whose input is the
   field plus a share of the polarisation, and a reversible part parallel to them:

     x = H + feedback*J,   J = relays(x) + curve(x),   B = mu0*H + J

   The density is given by its integral, the Everett function: a table E over the node of a reversal
   and the node of the end of a monotone path. E is the change of the relays' polarisation on this
   path. E(a, b) = -E(b, a) = E(-b, -a). Nodes have equal steps of y = x/(|x| + knee) from -reach to
   reach; between them E is bilinear in y, outside it is constant. The table is therefore the exact
   iron, without an interpolation error: relays whose density is constant in each cell of the table.
   Relays in cells on the diagonal are reversible.

   The memory contains the nested reversal points that no larger loop has deleted. If it is full,
   paths within its last loop run back and forth on one branch without losses, and a larger loop
   deletes them. */
#ifndef ANHYST_PLANT_PREISACH_H
#define ANHYST_PLANT_PREISACH_H

#include "anhyst_plant/curve.h"

#define ANHYST_PLANT_TURNS 512

typedef struct {
  const double *everett; /* `nodes` rows of `nodes` entries, T; rises along a row */
  int nodes;             /* >= 2 */
  double knee;           /* A/m */
  double reach;          /* of y, below 1 */
  double feedback;       /* A/m per T; x must not fall as H rises */
  anhyst_plant_curve curve;
} anhyst_plant_preisach_steel;

typedef struct {
  double at;     /* x, A/m */
  double relays; /* contribution of the relays to the polarisation there, T */
} anhyst_plant_turn;

typedef struct {
  int turns;
  anhyst_plant_turn turn[ANHYST_PLANT_TURNS]; /* the outermost first */
  double relays;                              /* present polarisation of the relays, T */
} anhyst_plant_preisach;

typedef struct {
  int turns; /* reversal points at the goal; one more after a reversal at the present field */
  double relays;
} anhyst_plant_preisach_goal;

#endif
