/* SPDX-License-Identifier: Apache-2.0 */

struct anhyst_force_controller_x;

/* A method: how a force controller finds its current. The functions below say what these have to
   do, and call them. A further method is a file with such a table and an init of its own. */
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

/* One force controller. */
typedef struct anhyst_force_controller_x {
  const anhyst_force_method_x *method;
  void *own;                        /* of a method that keeps its state elsewhere */
  const anhyst_map_x *map;          /* of the methods map and flux, or past it */
  const anhyst_flux_loop_x *loop;   /* of the method flux */
  anhyst_compensator_x compensator; /* of the method compensator, or past it */
  ANHYST_REAL low;                  /* limits of the current, where a map finds it */
  ANHYST_REAL high;
  ANHYST_REAL expected;   /* flux density that should show by now */
  ANHYST_REAL integral;   /* of the current */
  ANHYST_REAL demand;     /* solved for, within limits */
  ANHYST_REAL wanted;     /* current of the solve, before its limits */
  ANHYST_REAL current;    /* and within */
  ANHYST_REAL correction; /* part of it that the measured flux added */
  ANHYST_REAL error;      /* of the flux density */
  ANHYST_REAL flux;       /* density of the force solved for */
  uint16_t flags;         /* of the last solve, see flags.h */
  uint16_t solved;        /* whether there was a solve since the last commit */
} anhyst_force_controller_x;

/* The method compensator, unless it is bypassed. */
extern const anhyst_force_method_x anhyst_force_by_compensator_x;

/* ANHYST_OK, or ANHYST_BAD_PARAMETER where parameters are out of range; nothing is changed then.
   What is pointed to must live as long as the controller. */
anhyst_status anhyst_force_controller_init_map_x(anhyst_force_controller_x *c,
                                                 const anhyst_map_x *map, ANHYST_REAL low,
                                                 ANHYST_REAL high);
anhyst_status anhyst_force_controller_init_flux_x(anhyst_force_controller_x *c,
                                                  const anhyst_map_x *map,
                                                  const anhyst_flux_loop_x *loop, ANHYST_REAL low,
                                                  ANHYST_REAL high);

/* Goes past the compensator from the next solve on: a valid map finds the current, within
   low..high, and the compensator only commits what is applied, so that its memory stays that of the
   iron. map 0: by the compensator again. For a force controller with a compensator, between two
   ticks. */
void anhyst_force_controller_bypass_x(anhyst_force_controller_x *c, const anhyst_map_x *map,
                                      ANHYST_REAL low, ANHYST_REAL high);

/* Corrects a compensator by the measured flux from the next solve on, within low..high and by no
   more than the loop says. What it adds is of no iron that the compensator knows, which commits the
   rest. ANHYST_OK, or ANHYST_BAD_PARAMETER where parameters are out of range; nothing is changed
   then. For a force controller with a compensator, before its first tick. */
anhyst_status anhyst_force_controller_fuse_x(anhyst_force_controller_x *c,
                                             const anhyst_flux_loop_x *loop, ANHYST_REAL low,
                                             ANHYST_REAL high);

/* The current that gives the demanded force now, within the controller's limits. flux is looked at
   by the method flux, and fused with it. */
static inline ANHYST_REAL anhyst_force_controller_solve_x(anhyst_force_controller_x *c,
                                                          ANHYST_REAL demand, ANHYST_REAL gap,
                                                          ANHYST_REAL flux)
{
  return c->method->solve(c, demand, gap, flux);
}

/* Goes on to the next tick with the current that was applied, at the gap there was; the force that
   it is expected to give. If the current is the solved one, that is the demand itself, to the bit,
   as far as no limit was in the way. */
static inline ANHYST_REAL anhyst_force_controller_commit_x(anhyst_force_controller_x *c,
                                                           ANHYST_REAL applied, ANHYST_REAL gap)
{
  return c->method->commit(c, applied, gap);
}

/* The force that the last committed current is expected to give at a gap. Nothing changes. */
static inline ANHYST_REAL anhyst_force_controller_expected_x(const anhyst_force_controller_x *c,
                                                             ANHYST_REAL applied, ANHYST_REAL gap)
{
  return c->method->expected(c, applied, gap);
}

/* Ticks of the sequence that makes the state of the iron known, 0 where there is none; and the
   current of its tick 0, 1, ... Apply and commit it as any other. */
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

/* Takes the iron for demagnetised from now on. */
static inline void anhyst_force_controller_demagnetise_x(anhyst_force_controller_x *c)
{
  c->method->demagnetise(c);
}

/* Goes on with another block of the compensator, between two ticks; see anhyst_compensator_swap.
   Without a compensator nothing changes. */
static inline void anhyst_force_controller_carry_x(anhyst_force_controller_x *c,
                                                   const anhyst_block_x *block)
{
  c->method->carry(c, block);
}
