/* SPDX-License-Identifier: Apache-2.0 */

struct anhyst_force_controller_x;

/* The functions of a method, for the inline functions below, which state their purpose. A new
   method is a file with such a table and an init function. */
typedef struct {
  ANHYST_REAL (*solve)(struct anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                       ANHYST_REAL flux);
  ANHYST_REAL (*commit)(struct anhyst_force_controller_x *c, ANHYST_REAL applied, ANHYST_REAL gap);
  ANHYST_REAL (*expected)(const struct anhyst_force_controller_x *c, ANHYST_REAL applied,
                          ANHYST_REAL gap);
  int32_t (*conditioning_length)(const struct anhyst_force_controller_x *c);
  ANHYST_REAL (*conditioning)(const struct anhyst_force_controller_x *c, int32_t tick);
  void (*demagnetise)(struct anhyst_force_controller_x *c);
  void (*carry)(struct anhyst_force_controller_x *c, const anhyst_block_x *block);
} anhyst_force_method_x;

/* A force controller. */
typedef struct anhyst_force_controller_x {
  const anhyst_force_method_x *method;
  void *own;                        /* state of the method, if stored outside this structure */
  const anhyst_map_x *map;          /* map of the method map or flux, or of a bypass */
  const anhyst_flux_loop_x *loop;   /* parameters of the method flux, or of a fused compensator */
  anhyst_compensator_x compensator; /* compensator of the method, also during a bypass */
  ANHYST_REAL low;                  /* lowest and highest current of a map or a flux loop */
  ANHYST_REAL high;
  ANHYST_REAL expected;          /* flux density that is expected in this tick */
  ANHYST_REAL integral;          /* integral of the flux error, a current */
  ANHYST_REAL demand;            /* demand of the last solve, within limits */
  ANHYST_REAL unlimited_current; /* current of the last solve before its limits */
  ANHYST_REAL current;           /* current of the last solve within its limits */
  ANHYST_REAL correction;        /* current that the flux loop added */
  ANHYST_REAL error;             /* expected minus measured flux density */
  ANHYST_REAL flux;              /* flux density for the demanded force */
  uint16_t flags;                /* flags of the last solve, see flags.h */
  uint16_t solved;               /* whether solve was called after the last commit */
} anhyst_force_controller_x;

/* The functions of the compensator method without a bypass. */
extern const anhyst_force_method_x anhyst_force_by_compensator_x;

/* Initialise a force controller with the method `map` or `flux`. Return ANHYST_OK, or
   ANHYST_BAD_PARAMETER if a parameter is out of its range; then *c is unchanged. The map and the
   loop must live as long as the controller. */
anhyst_status anhyst_force_controller_init_map_x(anhyst_force_controller_x *c,
                                                 const anhyst_map_x *map, ANHYST_REAL low,
                                                 ANHYST_REAL high);
anhyst_status anhyst_force_controller_init_flux_x(anhyst_force_controller_x *c,
                                                  const anhyst_map_x *map,
                                                  const anhyst_flux_loop_x *loop, ANHYST_REAL low,
                                                  ANHYST_REAL high);

/* Bypasses the compensator from the next solve on. A valid map then gives the current, within
   low..high. The compensator only commits the applied current, so that its hysteresis state remains
   that of the iron. A null map ends the bypass. Requires a compensator. Call between two ticks. */
void anhyst_force_controller_bypass_x(anhyst_force_controller_x *c, const anhyst_map_x *map,
                                      ANHYST_REAL low, ANHYST_REAL high);

/* Adds a flux loop to a compensator. The loop corrects the current by the measured flux density,
   within low..high and by at most loop->most. The compensator commits the current without this
   correction, because the correction does not belong to its model of the iron. Returns ANHYST_OK,
   or ANHYST_BAD_PARAMETER if a parameter is out of its range; then *c is unchanged. Requires a
   force controller with a compensator. Call before its first tick. */
anhyst_status anhyst_force_controller_fuse_x(anhyst_force_controller_x *c,
                                             const anhyst_flux_loop_x *loop, ANHYST_REAL low,
                                             ANHYST_REAL high);

/* Returns the current for the demanded force, within the limits of the controller. The measured
   flux density `flux` is used only by the method `flux` and by a fused compensator. */
static inline ANHYST_REAL anhyst_force_controller_solve_x(anhyst_force_controller_x *c,
                                                          ANHYST_REAL demand, ANHYST_REAL gap,
                                                          ANHYST_REAL flux)
{
  return c->method->solve(c, demand, gap, flux);
}

/* Advances to the next tick with the applied current at the actual gap. Returns the expected force,
   which is exactly the demand if the applied current is the solved one and no limit applied. */
static inline ANHYST_REAL anhyst_force_controller_commit_x(anhyst_force_controller_x *c,
                                                           ANHYST_REAL applied, ANHYST_REAL gap)
{
  return c->method->commit(c, applied, gap);
}

/* Returns the expected force of the last committed current at a gap. Changes nothing. */
static inline ANHYST_REAL anhyst_force_controller_expected_x(const anhyst_force_controller_x *c,
                                                             ANHYST_REAL applied, ANHYST_REAL gap)
{
  return c->method->expected(c, applied, gap);
}

/* Return the number of ticks of the conditioning sequence (0: there is none), and the current of
   its tick 0, 1, ... WARNING: the actuator may move. Apply and commit the current like any
   other. */
static inline int32_t
anhyst_force_controller_conditioning_length_x(const anhyst_force_controller_x *c)
{
  return c->method->conditioning_length(c);
}
static inline ANHYST_REAL anhyst_force_controller_conditioning_x(const anhyst_force_controller_x *c,
                                                                 int32_t tick)
{
  return c->method->conditioning(c, tick);
}

/* Sets the state to that of demagnetised iron. */
static inline void anhyst_force_controller_demagnetise_x(anhyst_force_controller_x *c)
{
  c->method->demagnetise(c);
}

/* Switches to another parameter block of the compensator, between two ticks; see
   anhyst_compensator_swap. Has no effect without a compensator. */
static inline void anhyst_force_controller_carry_x(anhyst_force_controller_x *c,
                                                   const anhyst_block_x *block)
{
  c->method->carry(c, block);
}
