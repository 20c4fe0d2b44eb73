/* SPDX-License-Identifier: Apache-2.0 */
/* A moving Preisach iron: relays with a density of its own over their two switching fields, which
   see the field and a share of the polarisation, and a reversible part beside them:

     x = H + feedback*J,   J = relays(x) + curve(x),   B = mu0*H + J

   The density comes as its integral, the Everett function: a table E over the node of the turn and
   the node of the end of a straight way, by which the polarisation of the relays changes on it.
   E(a, b) = -E(b, a), and it is E(-b, -a). Nodes lie in equal steps of y = x/(|x| + knee) from
   -reach to reach; between them E is bilinear in y, beyond them it stays. So the table IS the iron:
   relays whose density is constant over a cell of the table, without an error of its own. Those of
   the cells on the diagonal are reversible.

   The memory is the nested turning points that no larger way has wiped out. Should it be full, the
   ways inside its last loop are run back and forth on one branch: they cost nothing, and a larger
   way wipes them out as ever. */
#ifndef ANHYST_PLANT_PREISACH_H
#define ANHYST_PLANT_PREISACH_H

#include "anhyst_plant/curve.h"

#define ANHYST_PLANT_TURNS 512

typedef struct {
  const double *everett; /* nodes rows of nodes entries, T; rises along a row */
  int nodes;             /* >= 2 */
  double knee;           /* A/m */
  double reach;          /* of y, below 1 */
  double feedback;       /* A/m for each T; x must not fall as H rises */
  anhyst_plant_curve curve;
} anhyst_plant_preisach_steel;

typedef struct {
  double at;     /* x, A/m */
  double relays; /* what they add to the polarisation there, T */
} anhyst_plant_turn;

typedef struct {
  int turns;
  anhyst_plant_turn turn[ANHYST_PLANT_TURNS]; /* the outermost first */
  double relays;                              /* what they add to the polarisation now, T */
} anhyst_plant_preisach;

typedef struct {
  int turns; /* that are left there; one more than there were: it turns where it stands */
  double relays;
} anhyst_plant_preisach_goal;

#endif
