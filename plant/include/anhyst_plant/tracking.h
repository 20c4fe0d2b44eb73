/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a mass between two magnets that follows a set-point. It joins a PID (error to
   force), the force that is fed forward, the allocation of the force to the magnets, and the
   product's force controllers (force to current) in their own number format.

   Allocation, class AB: both magnets always pull, and the product of what they pull is constant,

     F_1*F_2 = idle^2,   F_1 - F_2 = F

   At rest both pull with the idle force; for a large force the other one is let go of smoothly.
   Constants instead of a curve need class A: one magnet gets half of the wanted force more than a
   bias, the other one half of it less. */
#ifndef ANHYST_PLANT_TRACKING_H
#define ANHYST_PLANT_TRACKING_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/compensator/force_controller_real.h"
#include "anhyst_plant/controller.h"

#define ANHYST_TRACKING_MAGNETS 2

#ifdef __cplusplus
extern "C" {
#endif

/* Which SI quantities the signals of fixed point stand for. */
typedef struct {
  double demand;   /* full scales: N */
  double current;  /* A */
  double flux;     /* density, T */
  double gap_low;  /* range of the gap, m */
  double gap_high; /* m */
} anhyst_tracking_scales;

/* A force controller of any number format, in SI units. */
typedef struct {
  void *self;
  anhyst_tracking_scales scales;
  double (*solve)(void *self, const anhyst_tracking_scales *scales, double force, double gap,
                  double flux);
  void (*commit)(void *self, const anhyst_tracking_scales *scales, double applied, double gap);
} anhyst_tracking_drive;

/* Behind these self is a force controller of that format. */
double anhyst_tracking_solve_q31(void *self, const anhyst_tracking_scales *scales, double force,
                                 double gap, double flux);
double anhyst_tracking_solve_f64(void *self, const anhyst_tracking_scales *scales, double force,
                                 double gap, double flux);
double anhyst_tracking_solve_f32(void *self, const anhyst_tracking_scales *scales, double force,
                                 double gap, double flux);
void anhyst_tracking_commit_q31(void *self, const anhyst_tracking_scales *scales, double applied,
                                double gap);
void anhyst_tracking_commit_f64(void *self, const anhyst_tracking_scales *scales, double applied,
                                double gap);
void anhyst_tracking_commit_f32(void *self, const anhyst_tracking_scales *scales, double applied,
                                double gap);

typedef struct {
  double forward[3]; /* PID: force = forward[0]*e + state */
  double back[2];
  double idle;         /* force of either magnet without a net force, N */
  int by_halves;       /* whether it is shared out by class A around that force */
  double gap_total;    /* of both gaps, m */
  double current_low;  /* of the references to the amplifiers, A */
  double current_high; /* A */
  double current_step; /* of their converters, A; 0: none */
  anhyst_tracking_drive drive[ANHYST_TRACKING_MAGNETS];
  double state[2]; /* of the PID, N */
} anhyst_tracking;

/* Shares a net force out; force[0] pulls where it is positive. */
void anhyst_tracking_allocate(double net, double idle, double force[ANHYST_TRACKING_MAGNETS]);

/* As the tick of an anhyst_loop_controller whose self is an anhyst_tracking. target is the wanted
   position, load the net force that is fed forward, N. */
void anhyst_tracking_tick(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
