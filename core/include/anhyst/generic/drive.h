/* SPDX-License-Identifier: Apache-2.0 */

/* How the measured flux corrects the current; constant. T is the length of a tick. */
typedef struct {
  ANHYST_NAME(anhyst_map) wanted; /* flux density of a force */
  ANHYST_REAL proportional;       /* k_p, current for a unit of flux density */
  ANHYST_REAL integral;           /* k_i*T */
  ANHYST_REAL back;               /* share of applied - solved that the integral takes, 0..1 */
  ANHYST_REAL smoothing; /* share of a step that is expected to show in a tick, 0 < .. <= 1 */
} ANHYST_NAME(anhyst_flux_loop);

/* One drive. */
typedef struct {
  const ANHYST_NAME(anhyst_map) *map;          /* of the kinds map and flux */
  const ANHYST_NAME(anhyst_flux_loop) *loop;   /* of the kind flux */
  ANHYST_NAME(anhyst_compensator) compensator; /* of the kind compensator */
  ANHYST_REAL low; /* limits of the current, of the kinds map and flux */
  ANHYST_REAL high;
  ANHYST_REAL expected;   /* flux density that should show by now */
  ANHYST_REAL integral;   /* of the current */
  ANHYST_REAL demand;     /* solved for, within limits */
  ANHYST_REAL wanted;     /* current of the solve, before its limits */
  ANHYST_REAL current;    /* and within */
  ANHYST_REAL correction; /* part of it that the measured flux added */
  ANHYST_REAL error;      /* of the flux density */
  ANHYST_REAL flux;       /* density of the force solved for */
  uint16_t kind;          /* see drive_kind.h */
  uint16_t flags;         /* of the last solve, see flags.h */
  uint16_t solved;        /* whether there was a solve since the last commit */
} ANHYST_NAME(anhyst_drive);

/* The functions are those of drive.h. A probe that is not there gives what is not a number. */

anhyst_status ANHYST_NAME(anhyst_drive_init_map)(ANHYST_NAME(anhyst_drive) *drive,
                                                 const ANHYST_NAME(anhyst_map) *map,
                                                 ANHYST_REAL low, ANHYST_REAL high);
anhyst_status ANHYST_NAME(anhyst_drive_init_compensator)(
    ANHYST_NAME(anhyst_drive) *drive, const ANHYST_NAME(anhyst_parameters) *parameters);
anhyst_status ANHYST_NAME(anhyst_drive_init_flux)(ANHYST_NAME(anhyst_drive) *drive,
                                                  const ANHYST_NAME(anhyst_map) *map,
                                                  const ANHYST_NAME(anhyst_flux_loop) *loop,
                                                  ANHYST_REAL low, ANHYST_REAL high);

ANHYST_REAL ANHYST_NAME(anhyst_drive_solve)(ANHYST_NAME(anhyst_drive) *drive, ANHYST_REAL demand,
                                            ANHYST_REAL gap, ANHYST_REAL flux);

ANHYST_REAL ANHYST_NAME(anhyst_drive_commit)(ANHYST_NAME(anhyst_drive) *drive, ANHYST_REAL applied,
                                             ANHYST_REAL gap);

int32_t ANHYST_NAME(anhyst_drive_conditioning_length)(const ANHYST_NAME(anhyst_drive) *drive);
ANHYST_REAL ANHYST_NAME(anhyst_drive_conditioning)(const ANHYST_NAME(anhyst_drive) *drive,
                                                   int32_t tick);
