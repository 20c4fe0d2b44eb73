/* SPDX-License-Identifier: Apache-2.0 */
/* The interface between a simulated loop and its controller: SI units, one call per tick. The
   arrays belong to the loop: one number for each magnet, position head, or free coordinate of the
   body (m and N, or rad and N m). */
#ifndef ANHYST_PLANT_CONTROLLER_H
#define ANHYST_PLANT_CONTROLLER_H

#include <stdint.h>

/* Inputs of a controller at one tick. */
typedef struct {
  int magnets;
  int heads;
  int coordinates;
  const double *head;     /* readings of the position heads, m; NAN: the sample was dropped */
  const double *position; /* absolute position of each coordinate: pose plus frame position */
  const double *current;  /* current of each magnet, from a shunt, A */
  const double *flux;     /* flux density of each magnet, from a probe, T; NAN without a probe */
  const double *target;   /* target position of each coordinate */
  const double *load;     /* feedforward force of each coordinate */
  uint32_t command;       /* 0 none, 1 condition, 2 demagnetised, 3 lift, 4 land, 5 stop, 6 clear */
} anhyst_loop_sample;

/* Answer of a controller. All arrays are zero before the call. */
typedef struct {
  double *current;   /* references of the amplifiers, A; limited, on the converter's grid */
  double *reference; /* present reference position of each coordinate */
  double *demand;    /* demanded net force of each coordinate */
  uint16_t state;    /* 16*state + phase (levitation.h) + 256*(highest number of a lost magnet) */
  uint16_t flags;    /* flags of levitation.h and flags.h, combined by OR over the drives */
  int gone;          /* 1: the controller has ended; the other members are not valid */
} anhyst_loop_answer;

typedef struct {
  void *self;
  void (*tick)(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer);
} anhyst_loop_controller;

/* One of the product's controllers in one number format, and the scales of its signals. Its tick
   function is that of an anhyst_loop_controller whose member `self` is this adapter. */
#define ANHYST_PLANT_DECLARE_ADAPTER(kind, f)                                                      \
  typedef struct {                                                                                 \
    anhyst_##kind##_##f *kind;                                                                     \
    anhyst_##kind##_scales scales;                                                                 \
  } anhyst_##kind##_adapter_##f;                                                                   \
  void anhyst_##kind##_adapter_tick_##f(void *self, const anhyst_loop_sample *sample,              \
                                        anhyst_loop_answer *answer)

#endif
