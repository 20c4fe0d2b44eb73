/* SPDX-License-Identifier: Apache-2.0 */
/* All that a simulated loop knows of its controller: in SI units, one call a tick. Arrays are the
   loop's: a number a magnet, a position head, or a free coordinate of the body (m and N, or rad and
   N m). */
#ifndef ANHYST_PLANT_CONTROLLER_H
#define ANHYST_PLANT_CONTROLLER_H

#include <stdint.h>

/* What the controller is given at one tick. */
typedef struct {
  int magnets;
  int heads;
  int coordinates;
  const double *head;     /* as the position heads say, m; NAN: the sample was dropped */
  const double *position; /* pose and place of the frame, as an interferometer says */
  const double *current;  /* of each magnet, as the shunts say, A */
  const double *flux;     /* of each, as the flux probes say, T; NAN without */
  const double *target;   /* wanted position of each coordinate */
  const double *load;     /* force that is fed forward, likewise */
  uint32_t command;       /* 0 none, 1 condition, 2 demagnetised, 3 lift, 4 land, 5 stop, 6 clear */
} anhyst_loop_sample;

/* What it answers; the arrays are zero before. */
typedef struct {
  double *current;   /* references to the amplifiers, A, within limits and on the DAC's grid */
  double *reference; /* position now controlled to, of each coordinate */
  double *demand;    /* wanted net force, likewise */
  uint16_t state; /* 16*state + phase, see levitation.h, + 256 times the highest number of a magnet
                     that is lost */
  uint16_t flags; /* see flags.h, or-ed over the drives, and levitation.h */
  int gone;       /* there is no controller any more, and nothing else of this is to be believed */
} anhyst_loop_answer;

typedef struct {
  void *self;
  void (*tick)(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer);
} anhyst_loop_controller;

/* One of the product's controllers, in one format, and what its signals stand for. The tick is that
   of an anhyst_loop_controller whose self is the adapter. */
#define ANHYST_PLANT_ADAPTER(kind, f)                                                              \
  typedef struct {                                                                                 \
    anhyst_##kind##_##f *kind;                                                                     \
    anhyst_##kind##_scales scales;                                                                 \
  } anhyst_##kind##_adapter_##f;                                                                   \
  void anhyst_##kind##_adapter_tick_##f(void *self, const anhyst_loop_sample *sample,              \
                                        anhyst_loop_answer *answer)

#endif
