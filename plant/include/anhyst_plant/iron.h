/* SPDX-License-Identifier: Apache-2.0 */
/* Irons of several families with one interface; none is the Jiles-Atherton model. An iron consists
   of its steel (parameters) and its memory (state). The state moves along monotone paths of one
   coordinate: the field of the anhysteretic curve (cells and Duhem iron) or of the relays (Preisach
   iron). Every family computes field and flux density, which both rise with the coordinate, and
   their slopes at the end of a path. */
#ifndef ANHYST_PLANT_IRON_H
#define ANHYST_PLANT_IRON_H

#include "anhyst_plant/cells.h"
#include "anhyst_plant/duhem.h"
#include "anhyst_plant/preisach.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLANT_MU0 1.25663706143591729539e-6

/* All zeros: demagnetised. */
typedef struct {
  double at;      /* coordinate, A/m */
  double stride;  /* last change of the coordinate, A/m */
  double field;   /* A/m */
  double density; /* flux density, T */
  union {
    anhyst_plant_cells cells;
    anhyst_plant_preisach preisach;
    anhyst_plant_duhem duhem;
  } own;
} anhyst_plant_memory;

/* A possible end point of a monotone path. */
typedef struct {
  double at;            /* A/m */
  double field;         /* A/m */
  double density;       /* flux density at this end, T */
  double field_slope;   /* slope of the field over the coordinate, no unit */
  double density_slope; /* slope of the flux density over the coordinate, T m/A */
  union {
    anhyst_plant_cells_goal cells;
    anhyst_plant_preisach_goal preisach;
    anhyst_plant_duhem duhem;
  } own;
} anhyst_plant_goal;

typedef struct anhyst_plant_iron anhyst_plant_iron;

/* An additional term n(B) of the equation, next to b*B: any rising function, with its slope. */
typedef struct {
  double (*needs)(void *self, double density, double *slope);
  void *self;
} anhyst_plant_beyond;

/* Computes the other members of a goal from its coordinate. If the coordinate does not change, the
   slopes are those of a movement in the last direction. */
typedef void (*anhyst_plant_look)(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory,
                                  anhyst_plant_goal *goal);

typedef struct {
  anhyst_plant_look look;
  /* Solves the equation of anhyst_plant_field. */
  void (*field)(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,
                double b, double r, double tolerance, const anhyst_plant_beyond *beyond,
                anhyst_plant_goal *goal);
  /* Moves the memory to a goal: sets the density and the state of the family. */
  void (*move)(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
               const anhyst_plant_goal *goal);
} anhyst_plant_family;

extern const anhyst_plant_family anhyst_plant_of_cells;
extern const anhyst_plant_family anhyst_plant_of_preisach;
extern const anhyst_plant_family anhyst_plant_of_duhem;

struct anhyst_plant_iron {
  const anhyst_plant_family *family;
  double slack; /* upper bound of the change of the coordinate minus the change of the field, A/m */
  union {
    anhyst_plant_cell_steel cells;
    anhyst_plant_preisach_steel preisach;
    anhyst_plant_duhem_steel duhem;
  } steel;
};

/* Finds the field H with a*H + b*B(H) + n(B) = r for a > 0 and b >= 0, on a monotone path. Does not
   change the memory. |a*H + b*B + n - r| <= tolerance. If `beyond` is null, n is 0. */
void anhyst_plant_field(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,
                        double b, double r, double tolerance, const anhyst_plant_beyond *beyond,
                        anhyst_plant_goal *goal);

/* Moves the memory to a goal. */
void anhyst_plant_move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                       const anhyst_plant_goal *goal);

#ifdef __cplusplus
}
#endif
#endif
