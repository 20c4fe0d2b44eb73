/* SPDX-License-Identifier: Apache-2.0 */
/* The magnetic circuit in physical units: drive to flux density and back, with eddy currents. */
#ifndef ANHYST_CIRCUIT_H
#define ANHYST_CIRCUIT_H

#include <stddef.h>

#include "anhyst/law/law.h"

/* Permeability of free space, V s/(A m). */
#define ANHYST_MU0 1.2566370614359173e-6

#ifdef __cplusplus
extern "C" {
#endif

/* Maximum number of layers of solid iron. */
#define ANHYST_LAYERS_MAX 16
/* Maximum number of hysteresis states of an iron: one for each layer and the laminated part. */
#define ANHYST_MEMORIES_MAX (ANHYST_LAYERS_MAX + 1)

/* A material in physical units. The structures behind the pointers must outlive it. Iron with
   several layers is solid: its field diffuses from the surface inwards (layers.c). */
typedef struct {
  const anhyst_law_f64 *law;
  const void *parameters; /* of the law */
  double saturation;      /* unit of the magnetisation in the law, A/m */
  double shape;           /* unit of the effective field in the law, A/m */
  double interaction;     /* alpha, below 1 */
  double grain;           /* scale of a state's numbers, reference of tolerances */
  int layers;             /* 1: uniform field */
  double surface;         /* share of the first layer in the section, above 0; 1: single layer */
  double laminated;       /* laminated share of the path, without eddy currents; 0 to below 1 */
} anhyst_iron_f64;

/* The circuit around the iron at one sample. All zeros: the drive is the field itself. */
typedef struct {
  double gap_ratio; /* rho: reluctance of the gap over that of an air-filled iron path, >= 0 */
  /* gamma/dt, A/(m T): field, from the surface to the middle of the solid part, that opposes each
     change of flux density, >= 0 */
  double eddy;
} anhyst_circuit_f64;

/* A solution before its commit. */
typedef struct {
  anhyst_solution_f64 solution[ANHYST_MEMORIES_MAX]; /* of each hysteresis state */
  double drive;                                      /* c_H*I, or the applied field, A/m */
  double field;                                      /* in the iron, A/m */
  double flux;                                       /* flux density B, T */
} anhyst_reaction_f64;

/* Initialises an iron with a law on the Langevin curve from physical parameters; pinning (k) and
   play_width (r_d) in A/m. Fills law. law and branch must outlive the iron; branch may be null
   unless step is exact. Returns ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_iron_init_f64(anhyst_iron_f64 *iron, anhyst_operator_f64 *law,
                                   anhyst_step step, double saturation, double shape,
                                   double pinning, double reversibility, double interaction,
                                   double play_width, const anhyst_branch_f64 *branch);

/* Initialises an iron with tabulated play cells, which must outlive it. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER for an interaction of 1 and more. */
anhyst_status anhyst_iron_of_cells_f64(anhyst_iron_f64 *iron, const anhyst_cells_f64 *cells,
                                       double interaction);

/* Sets the number of layers of an iron, 1 (initial value) to ANHYST_LAYERS_MAX. A state then
   consists of the hysteresis states of all layers, the surface first, and of the laminated part.
   Without an eddy field, all layers have the same field, and the iron behaves as before. Returns
   ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_iron_layers_f64(anhyst_iron_f64 *iron, int layers, double surface,
                                     double laminated);

/* Returns the number of hysteresis states in a state of the iron. */
int anhyst_memories_f64(const anhyst_iron_f64 *iron);

/* Returns the flux density of a state, T. From here on, state points to its first hysteresis
   state. */
double anhyst_flux_of_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state);

/* Commits a solution to the state from which it was found. */
void anhyst_accept_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                       const anhyst_reaction_f64 *reaction);

/* Solves for a given drive: x + (R/(1+R) - alpha)*M = (drive + eddy*B0)/(1+R), R = rho + eddy*mu0;
   the eddy field gamma*dB/dt uses backward Euler. Solid iron: the equations of layers.c, with an
   error of at most 1e-10 of the fields in them, or 1e-12 of the law's scale as a flux density. Does
   not change the state. Returns a status like anhyst_solve. */
anhyst_status anhyst_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double drive,
                                 anhyst_reaction_f64 *reaction);

/* Solves for a given flux density: x + (1-alpha)*M = B/mu0, then drive = x - alpha*M + rho*B/mu0 +
   eddy*(B - B0). Does not change the state. */
anhyst_status anhyst_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double flux,
                                 anhyst_reaction_f64 *reaction);

/* Advances the state with the drive that was really applied (after limits and the amplifier). Does
   not change the state after a failure. */
anhyst_status anhyst_commit_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                                const anhyst_circuit_f64 *circuit, double applied_drive);

/* Follows a whole record: for each of n samples, the given quantity is given[i] and the circuit
   rho[i], eddy[i]. With inverse = 0, given is the drive and found the flux density, otherwise vice
   versa. field[i] is the field in the iron. Advances the state. After a failure, *index is the
   sample, and the state that of the last valid sample. */
anhyst_status anhyst_record_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double *found, double *field, size_t *index);

/* Repeats a cycle of n samples until every number of the state returns within tol (fraction of the
   iron's grain) after one repetition. If a law drifts slowly, every fourth repetition is
   extrapolated. The state is then that of the steady-state cycle before its first sample; *cycles
   counts the repetitions. Returns ANHYST_NOT_SETTLED after most_cycles repetitions. */
anhyst_status anhyst_settle_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double tol, int most_cycles, int *cycles,
                                size_t *index);

#ifdef __cplusplus
}
#endif
#endif
