/* SPDX-License-Identifier: Apache-2.0 */
/* Irons of several families behind one table of operators; none of them is a Jiles-Atherton
   material. An iron is its steel and its memory.

   Every family answers where a straight way of one coordinate leads: field and flux density, which
   both rise with the coordinate, and their slopes on the way there. Of cells and of the Duhem iron
   this is the field of the curve, of the Preisach iron the field that its relays see. */
#ifndef ANHYST_PLANT_IRON_H
#define ANHYST_PLANT_IRON_H

#include "anhyst_plant/cells.h"
#include "anhyst_plant/duhem.h"
#include "anhyst_plant/preisach.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLANT_MU0 1.25663706143591729539e-6

/* All zero: demagnetised. */
typedef struct {
  double at;      /* coordinate, A/m */
  double stride;  /* by which it moved last */
  double field;   /* A/m */
  double density; /* flux density, T */
  union {
    anhyst_plant_cells cells;
    anhyst_plant_preisach preisach;
    anhyst_plant_duhem duhem;
  } own;
} anhyst_plant_memory;

/* Where the coordinate may move to. */
typedef struct {
  double at;            /* A/m */
  double field;         /* A/m */
  double density;       /* flux density there, T */
  double field_slope;   /* of the field over the coordinate */
  double density_slope; /* of the flux density over the coordinate, T m/A */
  union {
    anhyst_plant_cells_goal cells;
    anhyst_plant_preisach_goal preisach;
    anhyst_plant_duhem duhem;
  } own;
} anhyst_plant_goal;

typedef struct anhyst_plant_iron anhyst_plant_iron;

/* What stands outside an iron beyond b*B: any n(B) that rises, with its slope. */
typedef struct {
  double (*needs)(void *self, double density, double *slope);
  void *self;
} anhyst_plant_beyond;

/* Fills in all of a goal except its coordinate, which is given. If the coordinate does not move,
   the slopes are those of going on. */
typedef void (*anhyst_plant_look)(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory,
                                  anhyst_plant_goal *goal);

typedef struct {
  anhyst_plant_look look;
  /* Solves what anhyst_plant_field states. */
  void (*field)(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,
                double b, double r, double tolerance, const anhyst_plant_beyond *beyond,
                anhyst_plant_goal *goal);
  /* Moves there: density and own of the memory. */
  void (*move)(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
               const anhyst_plant_goal *goal);
} anhyst_plant_family;

extern const anhyst_plant_family anhyst_plant_of_cells;
extern const anhyst_plant_family anhyst_plant_of_preisach;
extern const anhyst_plant_family anhyst_plant_of_duhem;

struct anhyst_plant_iron {
  const anhyst_plant_family *family;
  double slack; /* by which the coordinate may move further than the field, A/m */
  union {
    anhyst_plant_cell_steel cells;
    anhyst_plant_preisach_steel preisach;
    anhyst_plant_duhem_steel duhem;
  } steel;
};

/* The field H for which a*H + b*B(H) + n(B) = r, for a > 0 and b >= 0, if the field moves there in
   a straight line; the memory is not touched. |a*H + b*B + n - r| <= tolerance. beyond null: n = 0.
 */
void anhyst_plant_field(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,
                        double b, double r, double tolerance, const anhyst_plant_beyond *beyond,
                        anhyst_plant_goal *goal);

/* Moves there. */
void anhyst_plant_move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                       const anhyst_plant_goal *goal);

#ifdef __cplusplus
}
#endif
#endif
