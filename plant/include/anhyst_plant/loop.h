/* SPDX-License-Identifier: Apache-2.0 */
/* A bearing and its controller in lock-step, and what is recorded of them.

   At tick n: the sensors are read, the controller answers, the bearing goes on by one tick; the
   answer takes effect where the bearing's delay says. Where the amplifier takes a voltage, a
   digital current controller stands between the two and runs once a tick. */
#ifndef ANHYST_PLANT_LOOP_H
#define ANHYST_PLANT_LOOP_H

#include <stddef.h>

#include "anhyst_plant/bearing.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* u = resistance*reference + gain*(reference - read) + integral; gain 0: not needed. */
typedef struct {
  double resistance; /* ohm */
  double gain;       /* V/A */
  double reset;      /* of the integral, V/A a tick */
  double limit;      /* V */
} anhyst_plant_current_loop;

typedef struct {
  const anhyst_plant_bearing *bearing;
  anhyst_plant_state *state;
  anhyst_loop_controller controller;
  anhyst_plant_current_loop current_loop;
  double integral[ANHYST_PLANT_MAGNETS]; /* of the current loop, V */
  uint64_t ticks;                        /* gone so far */
  int has_hall;
} anhyst_plant_loop;

/* What happens at each of n ticks. */
typedef struct {
  const double *target;    /* wanted gap, or position where the magnets move, m */
  const double *load;      /* force commanded to the load drive, N */
  const double *inject;    /* added to gap and position that the controller sees, m */
  const double *feed;      /* load that the controller is given, N */
  const uint32_t *command; /* as in controller.h; bit 8: the gap's sample is dropped */
  const double *frame;     /* where the magnets are at each of n + 1 ticks, m, positive where the
                              gap opens to; straight between. NULL: they stand still */
} anhyst_plant_events;

#define ANHYST_LOOP_DROP 256U

/* Columns of a record, one row a tick, all at its beginning. */
#define ANHYST_LOOP_COLUMNS 18
#define ANHYST_LOOP_NAMES                                                                          \
  "t_s reference_m gap_m gap_read_m velocity_m_per_s demand_N force_N load_N command_A current_A " \
  "current_read_A voltage_V flux_Wb flux_density_T command_2_A current_2_A state flags"

/* Runs n ticks and fills n rows. Stops early where a number ceases to be finite, and before a tick
   that the controller did not answer; returns the rows filled. */
size_t anhyst_plant_loop_run(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t n,
                             double *record);

#ifdef __cplusplus
}
#endif
#endif
