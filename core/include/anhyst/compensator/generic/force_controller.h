/* SPDX-License-Identifier: Apache-2.0 */

/* One force controller. */
typedef struct {
  const ANHYST_NAME(anhyst_map) *map;          /* of the methods map and flux, or past it */
  const ANHYST_NAME(anhyst_flux_loop) *loop;   /* of the method flux */
  ANHYST_NAME(anhyst_play_map) *play;          /* of the method play */
  ANHYST_NAME(anhyst_compensator) compensator; /* of the method compensator, or past it */
  ANHYST_REAL low;                             /* limits of the current, where a map finds it */
  ANHYST_REAL high;
  ANHYST_REAL expected;   /* flux density that should show by now */
  ANHYST_REAL integral;   /* of the current */
  ANHYST_REAL demand;     /* solved for, within limits */
  ANHYST_REAL wanted;     /* current of the solve, before its limits */
  ANHYST_REAL current;    /* and within */
  ANHYST_REAL correction; /* part of it that the measured flux added */
  ANHYST_REAL error;      /* of the flux density */
  ANHYST_REAL flux;       /* density of the force solved for */
  uint16_t method;        /* see force_method.h */
  uint16_t flags;         /* of the last solve, see flags.h */
  uint16_t solved;        /* whether there was a solve since the last commit */
} ANHYST_NAME(anhyst_force_controller);

/* ANHYST_OK, or ANHYST_BAD_PARAMETER where parameters are out of range; nothing is changed then.
   What is pointed to must live as long as the controller. */
anhyst_status ANHYST_NAME(anhyst_force_controller_init_map)(ANHYST_NAME(anhyst_force_controller) *c,
                                                            const ANHYST_NAME(anhyst_map) *map,
                                                            ANHYST_REAL low, ANHYST_REAL high);
/* The controller goes on with the play of a map that anhyst_play_map_init has made. */
void ANHYST_NAME(anhyst_force_controller_init_play)(ANHYST_NAME(anhyst_force_controller) *c,
                                                    ANHYST_NAME(anhyst_play_map) *play);
anhyst_status ANHYST_NAME(anhyst_force_controller_init_flux)(
    ANHYST_NAME(anhyst_force_controller) *c, const ANHYST_NAME(anhyst_map) *map,
    const ANHYST_NAME(anhyst_flux_loop) *loop, ANHYST_REAL low, ANHYST_REAL high);

/* Goes past the compensator from the next solve on: a valid map finds the current, within
   low..high, and the compensator only commits what is applied, so that its memory stays that of the
   iron. map 0: by the compensator again. For a force controller with a compensator, between two
   ticks. */
void ANHYST_NAME(anhyst_force_controller_bypass)(ANHYST_NAME(anhyst_force_controller) *c,
                                                 const ANHYST_NAME(anhyst_map) *map,
                                                 ANHYST_REAL low, ANHYST_REAL high);

/* The current that gives the demanded force now, within the controller's limits. flux is looked at
   by the method flux alone. */
ANHYST_REAL ANHYST_NAME(anhyst_force_controller_solve)(ANHYST_NAME(anhyst_force_controller) *c,
                                                       ANHYST_REAL demand, ANHYST_REAL gap,
                                                       ANHYST_REAL flux);

/* Goes on to the next tick with the current that was applied, at the gap there was; the force that
   it is expected to give. If the current is the solved one, that is the demand itself, to the bit,
   as far as no limit was in the way. */
ANHYST_REAL ANHYST_NAME(anhyst_force_controller_commit)(ANHYST_NAME(anhyst_force_controller) *c,
                                                        ANHYST_REAL applied, ANHYST_REAL gap);

/* Ticks of the sequence that makes the state of the iron known, 0 where there is none; and the
   current of its tick 0, 1, ... Apply and commit it as any other. */
int32_t ANHYST_NAME(anhyst_force_controller_conditioning_length)(
    const ANHYST_NAME(anhyst_force_controller) *c);
ANHYST_REAL ANHYST_NAME(anhyst_force_controller_conditioning)(
    const ANHYST_NAME(anhyst_force_controller) *c, int32_t tick);
