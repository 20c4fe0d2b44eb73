/* SPDX-License-Identifier: Apache-2.0 */
/* All that a simulated loop knows of its controller: in SI units, one call a tick. */
#ifndef ANHYST_PLANT_CONTROLLER_H
#define ANHYST_PLANT_CONTROLLER_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What the controller is given at one tick. */
typedef struct {
  double gap;        /* as the sensor says, m; NAN: the sample was dropped */
  double position;   /* gap and place of the magnets, as an interferometer says, m */
  double current[2]; /* as the shunts say, A */
  double flux[2];    /* as the Hall probes say, T; NAN without */
  double target;     /* wanted gap, or position where the magnets move, m */
  double load;       /* load that is fed forward, N */
  double inject;     /* what the loop has added to gap already (swept sine), m; for records */
  uint32_t command;  /* 0 none, 1 condition, 2 demagnetised, 3 lift, 4 land, 5 stop, 6 clear */
} anhyst_loop_sample;

/* What it answers. */
typedef struct {
  double current[2]; /* references to the amplifiers, A, within limits and on the DAC's grid */
  double reference;  /* gap now controlled to, m */
  double demand;     /* wanted net force, N */
  uint16_t state;    /* 16*state + phase, see levitation.h */
  uint16_t flags;    /* see flags.h, or-ed over the drives, and levitation.h */
  int gone; /* there is no controller any more, and nothing else of this is to be believed */
} anhyst_loop_answer;

typedef struct {
  void *self;
  void (*tick)(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer);
} anhyst_loop_controller;

#ifdef __cplusplus
}
#endif
#endif
