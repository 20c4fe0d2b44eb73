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
/* Maximum number of memories of a core: one for each layer and the laminated part. */
#define ANHYST_MEMORIES_MAX (ANHYST_LAYERS_MAX + 1)

/* An iron core in physical units. The structures behind the pointers must outlive the core. A core
   with several layers is solid: its field diffuses from the surface inwards (layers.c). */
typedef struct {
  const anhyst_law_f64 *law;
  const void *parameters; /* parameters of the law */
  double saturation;      /* unit of the magnetisation in the law, A/m */
  double shape;           /* unit of the effective field in the law, A/m */
  double interaction;     /* mean-field parameter alpha, below 1 */
  double state_scale;     /* scale of the numbers in a state: reference of tolerances */
  int layers;             /* number of layers; 1: uniform field */
  double area_fraction[ANHYST_LAYERS_MAX];      /* cross-section fraction of each layer */
  double diffusion_fraction[ANHYST_LAYERS_MAX]; /* fraction of gamma outside each layer, from the
                                                   next layer outwards; 0 at the surface */
  double laminated_fraction; /* part of the flux path without eddy currents, 0 to below 1 */
  /* Eddy circuit of a core with one layer, anhyst_iron_eddy_circuit_f64. */
  double leaky_fraction; /* part of the eddy currents in a ring with leakage flux, 0 to 1 */
  double leaky_delay;    /* delay of this ring divided by gamma, T m/A, >= 0 */
  double excess;         /* excess field for an eddy field of 1 A/m, sqrt(A/m), >= 0 */
} anhyst_iron_f64;

/* The circuit around the core at one sample. If both members are 0, the drive is the field. */
typedef struct {
  double gap_ratio; /* rho: reluctance of the gap / that of an air-filled iron path, >= 0 */
  /* gamma/dt, A/(m T), >= 0: field, summed from the surface to the middle of the solid part, that
     opposes a change of the flux density by 1 T in one sample */
  double eddy;
} anhyst_circuit_f64;

/* A solution before its commit. */
typedef struct {
  anhyst_solution_f64 solution[ANHYST_MEMORIES_MAX]; /* solution for each hysteresis state */
  double drive;                                      /* drive c_H*I, or the applied field, A/m */
  double field;                                      /* field in the iron, A/m */
  double flux;                                       /* flux density B, T */
  double ring_flux;                                  /* flux density inside a leaky ring, T */
} anhyst_reaction_f64;

/* Initialises an iron core with a Jiles-Atherton law from physical parameters. pinning (k) and
   play_width (r_d) are in A/m. Fills law. law and branch must outlive the core. branch may be null
   unless `step` is ANHYST_STEP_EXACT. Returns ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_iron_init_f64(anhyst_iron_f64 *iron, anhyst_operator_f64 *law,
                                   anhyst_step step, double saturation, double shape,
                                   double pinning, double reversibility, double interaction,
                                   double play_width, const anhyst_branch_f64 *branch);

/* Initialises an iron core with tabulated play cells, which must outlive it. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER if the interaction is 1 or more. */
anhyst_status anhyst_iron_of_cells_f64(anhyst_iron_f64 *iron, const anhyst_cells_f64 *cells,
                                       double interaction);

/* Sets the number of layers of a core, 1 (initial value) to ANHYST_LAYERS_MAX. The thickness of the
   layers is a geometric series: the surface has the given fraction of the cross-section, above 0,
   and is the thinnest layer below 1/layers. The eddy currents between two layers are proportional
   to the distance of their middles. A state then consists of the hysteresis states of all layers,
   from the surface inwards, and of the laminated part. If the circuit has no eddy field, all layers
   have the same field, and the core behaves as one with a single layer. Returns ANHYST_OK or
   ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_iron_layers_f64(anhyst_iron_f64 *iron, int layers, double surface,
                                     double laminated);

/* Sets how the eddy currents of a core with one layer depend on the rate. A fraction of them flows
   in a ring around the core with leakage flux, so that the flux density Z inside the ring follows B
   with a delay T. Domain walls cause an additional field, the excess loss. With the eddy field
   e(v) = gamma*v of a flux density that changes at the rate v:

     field = (1 - leaky)*e(dB/dt) + leaky*e(dZ/dt) +- excess*sqrt(|e(dB/dt)|),   T*dZ/dt = B - Z

   leaky_delay is T/gamma. Initial values: 0. Returns ANHYST_OK, or ANHYST_BAD_PARAMETER, also for a
   core with several layers. */
anhyst_status anhyst_iron_eddy_circuit_f64(anhyst_iron_f64 *iron, double leaky, double leaky_delay,
                                           double excess);

/* Returns the number of memories in a state of the core: hysteresis states, and the flux density
   inside a leaky ring as the last one. */
int anhyst_memories_f64(const anhyst_iron_f64 *iron);

/* Returns the number of hysteresis states in a state of the core. */
int anhyst_hysteresis_memories_f64(const anhyst_iron_f64 *iron);

/* Returns the flux density of a state, T. From here on, `state` is an array of memories. */
double anhyst_flux_of_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state);

/* Commits a solution to the state from which it was found. */
void anhyst_accept_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                       const anhyst_reaction_f64 *reaction);

/* Solves for a given drive, without changing the state. The equation is x + (R/(1+R) - alpha)*M =
   (drive + eddy*B0)/(1+R), R = rho + eddy*mu0. The eddy field gamma*dB/dt uses backward Euler. An
   excess loss is found to 1e-12 of the change of the flux. For a solid core, uses the equations of
   layers.c. The error of these equations is at most 1e-10 of
   their fields, or 1e-12 of the scale of the law as a flux density. Returns a status like
   anhyst_solve. */
anhyst_status anhyst_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double drive,
                                 anhyst_reaction_f64 *reaction);

/* Solves for a given flux density, without changing the state: x + (1-alpha)*M = B/mu0, then drive
   = x - alpha*M + rho*B/mu0 + eddy*(B - B0). B0 is the flux density of the state. */
anhyst_status anhyst_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double flux,
                                 anhyst_reaction_f64 *reaction);

/* Advances the state with the drive that was really applied (after limits and the amplifier). After
   an error, the state is unchanged. */
anhyst_status anhyst_commit_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                                const anhyst_circuit_f64 *circuit, double applied_drive);

/* Simulates a whole record. For each of n samples, the circuit is rho[i], eddy[i] and the given
   quantity given[i]. With inverse = 0, `given` is the drive and `found` the flux density, otherwise
   vice versa. field[i] is the field in the iron. Advances the state. After an error, *index is the
   sample, and the state is that of the last valid sample. */
anhyst_status anhyst_record_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double *found, double *field, size_t *index);

/* Repeats a cycle of n samples until the state is periodic: no number of the state then changes by
   more than tol*iron->state_scale in one repetition. If a law drifts slowly, every fourth
   repetition is extrapolated. The state is then that of the steady-state cycle before its first
   sample; *cycles counts the repetitions. Returns ANHYST_NOT_SETTLED after most_cycles cycles. */
anhyst_status anhyst_settle_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double tol, int most_cycles, int *cycles,
                                size_t *index);

#ifdef __cplusplus
}
#endif
#endif
