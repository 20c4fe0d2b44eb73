/* SPDX-License-Identifier: Apache-2.0 */
/* The drive of one magnet, in fixed point: wanted force in, current out, by one of

     map          current over force and gap without memory
     compensator  the inverse of hysteresis, with any kernel
     flux         a map, corrected until the measured flux density is the one of the wanted force

   At every tick: solve once or more, limit and apply the current, then commit what was applied.
   solve keeps what it found for the commit, but changes neither the memory of the iron nor an
   integral. commit tells which force to expect, for the integral of whoever asked for the force.

   Signals are q31: force and current over their full scales, the gap 0..1.0 over its range, the
   flux density over its full scale. */
#ifndef ANHYST_DRIVE_H
#define ANHYST_DRIVE_H

#include "anhyst/compensator.h"
#include "anhyst/drive_kind.h"
#include "anhyst/map.h"
#include "anhyst/pidd2.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The flux density of a probe that is not there, or gave no sample. */
#define ANHYST_NO_FLUX ANHYST_Q31_MIN

/* How the measured flux corrects the current; constant. U is the full scale of the current, B that
   of the flux density, T the length of a tick. */
typedef struct {
  anhyst_map_q31 wanted;      /* flux density of a force */
  anhyst_factor proportional; /* k_p*B/U */
  anhyst_factor integral;     /* k_i*T*B/U */
  anhyst_factor back;         /* share of applied - wanted that the integral takes in a tick in
                                 which the drive's limits cut the current */
  anhyst_factor smoothing;    /* minus the share of a step that is expected to show in a tick,
                                 -1..0, shift 0 or 1 */
} anhyst_flux_loop_q31;

/* One drive. */
typedef struct {
  const anhyst_map_q31 *map;        /* of the kinds map and flux */
  const anhyst_flux_loop_q31 *loop; /* of the kind flux */
  anhyst_compensator compensator;   /* of the kind compensator */
  int32_t low;                      /* limits of the current, of the kinds map and flux */
  int32_t high;
  int32_t expected;   /* flux density that should show by now, q30 */
  int32_t integral;   /* of the current, q30 */
  int32_t demand;     /* solved for, within limits */
  int32_t wanted;     /* current of the solve, before its limits */
  int32_t current;    /* and within */
  int32_t correction; /* part of it that the measured flux added */
  int32_t error;      /* of the flux density, q30 */
  int32_t flux;       /* density of the force solved for, q30 */
  uint16_t kind;      /* see drive_kind.h */
  uint16_t flags;     /* of the last solve, see flags.h */
  uint16_t solved;    /* whether there was a solve since the last commit */
} anhyst_drive_q31;

/* ANHYST_OK, or ANHYST_BAD_PARAMETER where parameters are not sound; nothing is changed then. What
   is pointed to must live as long as the drive. */
anhyst_status anhyst_drive_init_map_q31(anhyst_drive_q31 *drive, const anhyst_map_q31 *map,
                                        int32_t low, int32_t high);
anhyst_status anhyst_drive_init_compensator_q31(anhyst_drive_q31 *drive,
                                                const anhyst_kernel *kernel, const int16_t *words,
                                                uint16_t capacity);
anhyst_status anhyst_drive_init_flux_q31(anhyst_drive_q31 *drive, const anhyst_map_q31 *map,
                                         const anhyst_flux_loop_q31 *loop, int32_t low,
                                         int32_t high);

/* The current that gives the demanded force now, within the drive's limits. flux is looked at by
   the kind flux alone. */
int32_t anhyst_drive_solve_q31(anhyst_drive_q31 *drive, int32_t demand, int32_t gap, int32_t flux);

/* Goes on to the next tick with the current that was applied, at the gap there was; the force that
   it is expected to give. If the current is the solved one, that is the demand itself, to the bit,
   as far as no limit was in the way. */
int32_t anhyst_drive_commit_q31(anhyst_drive_q31 *drive, int32_t applied, int32_t gap);

/* Ticks of the sequence that makes the state of the iron known, 0 where there is none; and the
   current of its tick 0, 1, ... Apply and commit it as any other. */
int32_t anhyst_drive_conditioning_length_q31(const anhyst_drive_q31 *drive);
int32_t anhyst_drive_conditioning_q31(const anhyst_drive_q31 *drive, int32_t tick);

#ifdef __cplusplus
}
#endif
#endif
