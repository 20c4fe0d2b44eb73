/* SPDX-License-Identifier: Apache-2.0 */
/* A moving Preisach iron: relays with a density over their two switching fields, and a reversible
   part parallel to them. Relays and reversible part depend on the field plus a part of the
   polarisation:

        x = H + feedback*J,   J = relays(x) + curve(x),   B = mu0*H + J

   The density is given by its integral, the Everett function. This is a table E over two nodes:
   that of a reversal and that of the end of a monotone path. E is the change of the relays'
   polarisation on this path. E(a, b) = -E(b, a) = E(-b, -a). Nodes have equal steps of y = x/(|x| +
   knee) from -reach to reach. E is bilinear in y between nodes, and constant outside. The table
   therefore represents an iron exactly, without an interpolation error: its relays have a constant
   density in each cell of the table. Relays in cells on the diagonal are reversible.

   The memory contains the nested reversal points that no larger loop has deleted. If it is full,
   paths within its last loop stay on one branch without losses; a larger loop deletes them. */
#ifndef ANHYST_PLANT_PREISACH_H
#define ANHYST_PLANT_PREISACH_H

#include "anhyst_plant/curve.h"

#define ANHYST_PLANT_MAX_REVERSALS 512

typedef struct {
  const double *everett; /* table of `nodes` rows with `nodes` entries each, T; each row rises */
  int nodes;             /* >= 2 */
  double knee;           /* A/m */
  double reach;          /* largest y of the table, below 1 */
  double feedback;       /* A/m per T; x must not fall as H rises */
  anhyst_plant_curve curve;
} anhyst_plant_preisach_steel;

typedef struct {
  double at;     /* x, A/m */
  double relays; /* contribution of the relays to the polarisation at this point, T */
} anhyst_plant_turn;

typedef struct {
  int turns;
  anhyst_plant_turn turn[ANHYST_PLANT_MAX_REVERSALS]; /* reversal points, the outermost first */
  double relays;                                      /* present polarisation of the relays, T */
} anhyst_plant_preisach;

typedef struct {
  int turns; /* number of reversal points at the goal; a reversal at the present field adds one */
  double relays;
} anhyst_plant_preisach_goal;

#endif
