/* SPDX-License-Identifier: Apache-2.0 */
/* Physical quantities: drive to flux density and back, through a gap, with eddy currents. */
#ifndef ANHYST_CIRCUIT_H
#define ANHYST_CIRCUIT_H

#include <stddef.h>

#include "anhyst/law/law.h"

/* Permeability of free space, V s/(A m). */
#define ANHYST_MU0 1.2566370614359173e-6

#ifdef __cplusplus
extern "C" {
#endif

/* Layers of a solid iron, at most. */
#define ANHYST_LAYERS_MAX 16
/* Memories of an iron, at most: of each layer, and of what is laminated. */
#define ANHYST_MEMORIES_MAX (ANHYST_LAYERS_MAX + 1)

/* A material in physical units; what it points to must outlive it. One of several layers is solid:
   its field diffuses from the surface inwards (layers.c). */
typedef struct {
  const anhyst_law_f64 *law;
  const void *parameters; /* of the law */
  double saturation;      /* unit of the magnetisation in the law, A/m */
  double shape;           /* unit of the effective field in the law, A/m */
  double interaction;     /* alpha, below 1 */
  double grain;           /* size of a state's numbers, that a tolerance is a part of */
  int layers;             /* 1: the field is the same throughout */
  double surface;         /* share of the first layer in the section, above 0; 1 where it is all */
  double laminated;       /* share of the path in sheets, that follow at once; 0 up to below 1 */
} anhyst_iron_f64;

/* The circuit around the iron at one sample. All zero: the drive is the field itself. */
typedef struct {
  double gap_ratio; /* rho: reluctance of the gap over that of an air-filled iron path, >= 0 */
  /* gamma/dt, A/(m T): field, from the surface to the middle of what is solid, that opposes each
     change of flux density, >= 0 */
  double eddy;
} anhyst_circuit_f64;

/* A solution that has not been committed. */
typedef struct {
  anhyst_solution_f64 solution[ANHYST_MEMORIES_MAX]; /* of the memories */
  double drive;                                      /* c_H*I, or the applied field, A/m */
  double field;                                      /* in the iron, A/m */
  double flux;                                       /* flux density B, T */
} anhyst_reaction_f64;

/* Makes an iron of a law on the Langevin curve from physical parameters; k, r_d in A/m. Fills law,
   which must outlive the iron, as must the branch; that may be null unless step is exact. Returns
   ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_iron_init_f64(anhyst_iron_f64 *iron, anhyst_operator_f64 *law,
                                   anhyst_step step, double saturation, double shape,
                                   double pinning, double reversibility, double interaction,
                                   double play_width, const anhyst_branch_f64 *branch);

/* Makes an iron of play cells, tabulated; they must outlive it. Returns ANHYST_OK or
   ANHYST_BAD_PARAMETER for an interaction of 1 and more. */
anhyst_status anhyst_iron_of_cells_f64(anhyst_iron_f64 *iron, const anhyst_cells_f64 *cells,
                                       double interaction);

/* Makes an iron solid: 1 (as it is made) to ANHYST_LAYERS_MAX layers. Its state is then the
   memories of all layers, the surface first, and that of what is laminated. Where no eddy field
   holds them apart, all layers have one field, and the iron is what it was. Returns ANHYST_OK or
   ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_iron_layers_f64(anhyst_iron_f64 *iron, int layers, double surface,
                                     double laminated);

/* Memories that a state of the iron consists of. */
int anhyst_memories_f64(const anhyst_iron_f64 *iron);

/* Flux density of a state, T. Here and below a state is the first of its memories. */
double anhyst_flux_of_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state);

/* Takes a solution over into the state from which it was found. */
void anhyst_accept_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                       const anhyst_reaction_f64 *reaction);

/* Drive given: x + (R/(1+R) - alpha)*M = (drive + eddy*B0)/(1+R), R = rho + eddy*mu0; backward
   Euler for the eddy field gamma*dB/dt. Solid iron: the equations of layers.c, at worst to 1e-10
   of the fields in them, or to 1e-12 of the law's scale as a flux density. The state is not
   touched; status as anhyst_solve. */
anhyst_status anhyst_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double drive,
                                 anhyst_reaction_f64 *reaction);

/* Flux density given: x + (1-alpha)*M = B/mu0, then
   drive = x - alpha*M + rho*B/mu0 + eddy*(B - B0). The state is not touched. */
anhyst_status anhyst_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double flux,
                                 anhyst_reaction_f64 *reaction);

/* Advances the state with the drive that was really applied (after limits and the amplifier).
   On failure the state is unchanged. */
anhyst_status anhyst_commit_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                                const anhyst_circuit_f64 *circuit, double applied_drive);

/* A whole record: for each of n samples the given quantity in given[i] and the circuit in rho[i],
   eddy[i]; with inverse = 0 the given one is the drive and found[i] the flux density, otherwise the
   other way round. field[i] is the field in the iron. The state is advanced. On failure *index is
   the sample, and the state that of the last good one. */
anhyst_status anhyst_record_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double *found, double *field, size_t *index);

/* Repeats a cycle of n samples until every number of the state returns within tol (in parts of the
   iron's grain) after one repetition; where a law creeps, every fourth repetition is used to
   extrapolate. The state is then that of the settled cycle before its first sample; *cycles counts
   the repetitions. Returns ANHYST_NOT_SETTLED after most_cycles. */
anhyst_status anhyst_settle_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double tol, int most_cycles, int *cycles,
                                size_t *index);

#ifdef __cplusplus
}
#endif
#endif
