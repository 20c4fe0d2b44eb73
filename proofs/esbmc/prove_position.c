/* SPDX-License-Identifier: Apache-2.0 */
/* Proves a whole tick of the controller of a levitating armature, a swap of blocks, a switch of the
   compensation, or a change of gains, for any valid limits and settings, any state, any sample, and
   one magnet or two. Levitation, PIDD2 and force controllers are replaced by their proved
   contracts: each call is shown to be allowed, and returns any result. The currents stay within the
   limits of the board. The macro PART names the proved function. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#include "control/position.c"

static anhyst_position_limits_q31 limits;
static anhyst_position_settings_q31 settings;
static anhyst_position_settings_q31 other; /* settings with other gains */

static int is_current(int32_t current)
{
  return current >= limits.current_low && current <= limits.current_high;
}

/* ---- contracts ---- */

/* Whether settings are valid. The range need not be a multiple of the converter's step, because
   only round_to_grid needs that. */
static int are_settings_valid(const anhyst_position_limits_q31 *of,
                              const anhyst_position_settings_q31 *to)
{
  return anhyst_factor_is_valid(to->units.gap[0].factor) &&
         anhyst_factor_is_valid(to->units.gap[1].factor) && of->current_low < of->current_high &&
         of->current_step > 0 && of->release >= of->current_step && nondet_i16() != 0;
}

static int32_t round_to_grid(const anhyst_position_limits_q31 *of, int32_t current)
{
  SHOW(of == &limits && is_current(current));
  return any_within(limits.current_low, limits.current_high);
}

static inline int32_t anhyst_factor_product(int32_t x, anhyst_factor factor)
{
  (void)x;
  SHOW(anhyst_factor_is_valid(factor));
  return nondet_i32();
}

anhyst_status anhyst_pidd2_check_q31(const anhyst_pidd2_gains_q31 *gains)
{
  return nondet_i16() != 0 || gains->low > gains->high ? ANHYST_BAD_PARAMETER : ANHYST_OK;
}

static int position_holds(const anhyst_pidd2_state_q31 *state)
{
  return state->position >= -ANHYST_Q30_ONE && state->position < ANHYST_Q30_ONE;
}

static anhyst_pidd2_state_q31 any_state(void)
{
  const anhyst_pidd2_state_q31 state = {any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE - 1),
                                        nondet_i32(), nondet_i32()};
  return state;
}

void anhyst_pidd2_start_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                            int32_t reference, int32_t position, int32_t load, int32_t output)
{
  SHOW(gains == &settings.gains);
  *state = any_state();
}

int32_t anhyst_pidd2_solve_q31(const anhyst_pidd2_gains_q31 *gains,
                               const anhyst_pidd2_state_q31 *state, int32_t reference,
                               int32_t position, int32_t load,
                               anhyst_pidd2_candidate_q31 *candidate)
{
  SHOW(gains == &settings.gains && position_holds(state));
  candidate->next = any_state();
  candidate->output = any_within(settings.gains.low, settings.gains.high);
  return candidate->output;
}

void anhyst_pidd2_commit_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                             const anhyst_pidd2_candidate_q31 *candidate, int32_t applied)
{
  SHOW(gains == &settings.gains && position_holds(&candidate->next));
  *state = any_state();
}

void anhyst_pidd2_change_q31(const anhyst_pidd2_gains_q31 *from, const anhyst_pidd2_gains_q31 *to,
                             anhyst_pidd2_state_q31 *state, int32_t reference, int32_t position,
                             int32_t load)
{
  SHOW(from == &settings.gains && to == &other.gains && position_holds(state));
  *state = any_state();
}

anhyst_status anhyst_levitation_check(const anhyst_levitation_limits *of,
                                      const anhyst_levitation_settings *to)
{
  (void)of;
  (void)to;
  return nondet_i16() != 0 ? ANHYST_BAD_PARAMETER : ANHYST_OK;
}

void anhyst_levitation_start(anhyst_levitation *levitation) { levitation->phase = 0; }

uint16_t anhyst_levitation_command(anhyst_levitation *levitation, uint16_t command,
                                   uint16_t at_zero)
{
  levitation->phase = (uint16_t)any_within(0, ANHYST_PHASE_COUNT - 1);
  return nondet_u16();
}

void anhyst_levitation_tick(anhyst_levitation *levitation, const anhyst_levitation_limits *of,
                            const anhyst_levitation_settings *to,
                            const anhyst_levitation_input *input)
{
  anhyst_levitation next; /* any */
  ASSUME(next.supervisor.state < ANHYST_STATE_COUNT && next.phase < ANHYST_PHASE_COUNT);
  *levitation = next;
}

anhyst_status anhyst_map_check_q31(const anhyst_map_q31 *map)
{
  SHOW(map == settings.plain);
  return nondet_i16() != 0 ? ANHYST_BAD_PARAMETER : ANHYST_OK;
}

/* A force controller with any method: its functions return any result. */
static int32_t any_current(anhyst_force_controller_q31 *magnet, int32_t demand, int32_t gap,
                           int32_t flux)
{
  magnet->flags = nondet_u16();
  return nondet_i32();
}

static int32_t any_force(anhyst_force_controller_q31 *magnet, int32_t applied, int32_t gap)
{
  return nondet_i32();
}

static int32_t any_expected(const anhyst_force_controller_q31 *magnet, int32_t applied, int32_t gap)
{
  return nondet_i32();
}

static int32_t any_length(const anhyst_force_controller_q31 *magnet) { return nondet_i32(); }

static int32_t any_conditioning(const anhyst_force_controller_q31 *magnet, int32_t tick)
{
  return nondet_i32();
}

static void any_iron(anhyst_force_controller_q31 *magnet) { magnet->solved = 0; }

static void any_block(anhyst_force_controller_q31 *magnet, const int16_t *words)
{
  (void)words;
  magnet->solved = 0;
}

#define ANY_METHOD                                                                                 \
  {any_current, any_force, any_expected, any_length, any_conditioning, any_iron, any_block}
const anhyst_force_method_q31 anhyst_force_by_compensator_q31 = ANY_METHOD;
static const anhyst_force_method_q31 other_method = ANY_METHOD;

static const anhyst_force_method_q31 *any_method(void)
{
  return nondet_i16() != 0 ? &anhyst_force_by_compensator_q31 : &other_method;
}

void anhyst_force_controller_bypass_q31(anhyst_force_controller_q31 *magnet,
                                        const anhyst_map_q31 *map, int32_t low, int32_t high)
{
  SHOW(low <= high && (map == NULL || map == settings.plain));
  magnet->method = any_method();
}

/* ---- proof ---- */

static void show_state(const anhyst_position_q31 *c)
{
  SHOW(is_current(c->current[0]) && (c->magnet[1] == NULL || is_current(c->current[1])));
  SHOW(position_holds(&c->state));
  SHOW(c->pending == 0U || position_holds(&c->candidate.next));
}

static void prove_tick(anhyst_position_q31 *c)
{
  anhyst_position_sample_q31 sample; /* any */
  anhyst_position_answer_q31 answer;
  anhyst_position_tick_q31(c, &sample, &answer);
  SHOW(is_current(answer.current[0]) && (c->magnet[1] == NULL || is_current(answer.current[1])));
}

static void prove_swap(anhyst_position_q31 *c) { anhyst_position_swap_q31(c, NULL); }

static void prove_retune(anhyst_position_q31 *c)
{
  const anhyst_status done = anhyst_position_retune_q31(c, &other);
  SHOW(c->settings == (done == ANHYST_OK ? &other : &settings));
}

int main(void)
{
  anhyst_force_controller_q31 first;
  anhyst_force_controller_q31 second;
  anhyst_position_q31 c;
  anhyst_position_limits_q31 any_limits;
  anhyst_position_settings_q31 any_settings;
  anhyst_pidd2_gains_q31 any_gains;
  anhyst_map_q31 plain;
  first.method = any_method();
  second.method = any_method();
  limits = any_limits;
  settings = any_settings;
  settings.plain = nondet_i16() != 0 ? &plain : NULL;
  other = settings;
  other.gains = any_gains;
  ASSUME(anhyst_position_init_q31(&c, &limits, &settings, &first,
                                  nondet_i16() != 0 ? &second : NULL) == ANHYST_OK);
  show_state(&c);
  /* a tick from any state */
  c.levitation.phase = nondet_u16();
  c.state = any_state();
  c.candidate.next = any_state();
  c.position = nondet_i32();
  c.demand = nondet_i32();
  c.pending = nondet_u16();
  c.fading[0] = nondet_i32();
  c.fading[1] = nondet_i32();
  c.current[0] = any_within(limits.current_low, limits.current_high);
  c.current[1] = c.magnet[1] == NULL ? 0 : any_within(limits.current_low, limits.current_high);
  PART(&c);
  show_state(&c);
  return 0;
}
