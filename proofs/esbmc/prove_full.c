/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the kernel of the Jiles-Atherton law, function by function up to the whole step. The macro
   PART names the proved function. The functions that PART calls are replaced by their proved
   contracts (proofs.toml), which first show that the call is allowed. Words from tables have any
   value that anhyst_block_check accepts. */
#ifndef RAW_PRODUCTS
#define ANHYST_PORT_HEADER "contracts.h"
#endif
#include "any.h"

/* The search has up to 16 iterations, as the block states. proofs.toml inserts BEGIN_ANY_ITERATION
   and END_ANY_ITERATION at the start and the end of an iteration: they show the invariant and
   forget everything else, so that one iteration represents all. */
#define INVARIANT                                                                                  \
  (path->x <= within.low && within.low <= next && next <= within.high && within.high < UNIT &&     \
   last_step >= 0)
#define BEGIN_ANY_ITERATION                                                                        \
  SHOW(INVARIANT);                                                                                 \
  evaluations_left = any_within(1, 16);                                                            \
  within.low = nondet_i32();                                                                       \
  within.high = nondet_i32();                                                                      \
  last_step = nondet_i32();                                                                        \
  next = nondet_i32();                                                                             \
  was_rejected = nondet_i16();                                                                     \
  if (limit != 0 && nondet_i16() != 0) {                                                           \
    eq = limit;                                                                                    \
  }                                                                                                \
  ASSUME(INVARIANT);
#define END_ANY_ITERATION                                                                          \
  SHOW(INVARIANT);                                                                                 \
  ASSUME(0);

#define is_in_unit_range(a) ((a) >= -UNIT && (a) < UNIT)

/* Range of the iron weight in the search: either sign, or only negative if the control fault
   appears only there. */
#ifdef AGAINST_THE_AIR
#define MAX_IRON_WEIGHT (-1)
#else
#define MAX_IRON_WEIGHT ANHYST_Q15_MAX
#endif

#include "compensator/full.c"

/* Tables that a path uses. The replacement of interpolate() distinguishes them by their
   addresses. */
enum { CURVE_AT = ANHYST_BLOCK_LEAST_WORDS, BRANCH_AT, INVERSE_AT };
static int16_t block_words[INVERSE_AT + 1];
static const int16_t *const curve_words = block_words + CURVE_AT;
static const int16_t *const branch_words = block_words + BRANCH_AT;
static const int16_t *const inverse_words = block_words + INVERSE_AT;

static int32_t steepest(uint16_t n) { return ANHYST_Q15_MAX >> (n > 5U ? n - 5U : 0U); }

/* Fills the head of a block that passed its check; no table is read. */
static void fill_words(int16_t *words)
{
  words[ANHYST_WORD_FULL_CURVE] = CURVE_AT;
  words[ANHYST_WORD_FULL_BRANCH] = BRANCH_AT;
  words[ANHYST_WORD_FULL_INVERSE] = INVERSE_AT;
  words[ANHYST_WORD_FULL_CURVE_SEGMENTS] = (int16_t)any_within(3, 9);
  words[ANHYST_WORD_FULL_INVERSE_SEGMENTS] = (int16_t)any_within(3, 9);
  words[ANHYST_WORD_FULL_RATE] = (int16_t)any_within(1, ANHYST_Q15_MAX);
  words[ANHYST_WORD_FULL_RATE_SHIFT] = (int16_t)any_within(0, 12);
  words[ANHYST_WORD_FULL_AIR] = (int16_t)any_within(1, ANHYST_Q15_MAX);
  words[ANHYST_WORD_FULL_PLAY] = (int16_t)any_within(0, ANHYST_Q15_MAX);
  words[ANHYST_WORD_FULL_STEEPNESS] = (int16_t)any_within(1, ANHYST_Q15_MAX);
  words[ANHYST_WORD_FULL_REVERSIBLE] = (int16_t)any_within(0, ANHYST_Q15_MAX);
  words[ANHYST_WORD_FULL_ITERATIONS] = (int16_t)any_within(2, 16);
  words[ANHYST_WORD_CURRENT_SHIFT] = (int16_t)any_within(0, 8);
  words[ANHYST_WORD_CURRENT_LOW] = (int16_t)any_within(-ANHYST_Q15_MAX, ANHYST_Q15_MAX);
  words[ANHYST_WORD_CURRENT_HIGH] = (int16_t)any_within(-ANHYST_Q15_MAX, ANHYST_Q15_MAX);
}

static anhyst_full_memory any_memory(void)
{
  const anhyst_full_memory any = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(),
                                  nondet_i32()};
  return any;
}

/* Whether a path has the properties that init_path() gives it. */
static int has_begun(const branch_path *path)
{
  return is_in_unit_range(path->x) && is_in_unit_range(path->y) && is_in_unit_range(path->p) &&
         path->play >= 0 && path->play <= UNIT && path->tangent_step >= 0 &&
         path->tangent_step <= MAX_TANGENT_STEP;
}

static int has_departed(const branch_path *path)
{
  return is_in_unit_range(path->departure) && path->offset > -2 * UNIT && path->offset < 2 * UNIT;
}

/* Returns any path after find_departure(). */
static branch_path any_path(void)
{
  branch_path path;
  path.x = nondet_i32();
  path.y = nondet_i32();
  path.p = nondet_i32();
  path.play = nondet_i32();
  path.tangent_step = nondet_i32();
  path.curve.at = curve_words;
  path.curve.n = (uint16_t)any_within(3, 9);
  path.branch.at = branch_words;
  path.branch.n = (uint16_t)(path.curve.n + 1U);
  path.inverse.at = inverse_words;
  path.inverse.n = (uint16_t)any_within(3, 9);
  path.decay.rate = (int16_t)any_within(1, ANHYST_Q15_MAX);
  path.decay.shift = (uint16_t)any_within(0, 12);
  path.turn = any_within(-UNIT, UNIT - 1);
  path.level = any_within(-UNIT, UNIT - 1);
  path.departure = nondet_i32();
  path.offset = nondet_i32();
  path.kappa = any_within(0, UNIT);
  path.lead = nondet_i16();
  path.steepness = (int16_t)any_within(1, ANHYST_Q15_MAX);
  path.reversible = (int16_t)any_within(0, ANHYST_Q15_MAX);
  path.evaluations = (int16_t)any_within(2, 16);
  ASSUME(has_begun(&path) && has_departed(&path));
  return path;
}

static int is_slope(int32_t slope) { return slope >= 0 && slope <= ANHYST_SLOPE_MAX; }

static int is_answer(const branch_path *path, const path_point *point)
{
  return is_in_unit_range(point->x) && is_in_unit_range(point->p) && point->p >= path->p &&
         point->y >= path->y && point->y < UNIT && is_in_unit_range(point->m) &&
         is_slope(point->y_slope) && is_slope(point->m_slope);
}

static path_point any_answer(const branch_path *path)
{
  const path_point point = {nondet_i32(), nondet_i32(), nondet_i32(),
                            nondet_i32(), nondet_i32(), nondet_i32()};
  ASSUME(is_answer(path, &point));
  return point;
}

static int is_equation(const equation *eq)
{
  return eq->air > 0 && eq->iron >= -ANHYST_Q15_MAX && is_in_unit_range(eq->target);
}

static equation any_equation(void)
{
  const equation eq = {(int16_t)any_within(1, ANHYST_Q15_MAX),
                       (int16_t)any_within(-ANHYST_Q15_MAX, MAX_IRON_WEIGHT),
                       any_within(-UNIT, UNIT - 1)};
  return eq;
}

/* ---- contracts ---- */

#ifdef VALUE_BY_CONTRACT
static inline number interpolate(table t, number u, number *rise)
{
  SHOW(u >= 0 && u < UNIT);
  const int32_t least = t.at == branch_words ? -ANHYST_Q15_MAX : 0;
  const uint16_t n = t.at == branch_words ? (uint16_t)(t.n - 1U) : t.n;
  *rise = any_within(0, t.at == inverse_words ? ANHYST_Q15_MAX : steepest(n));
  return any_within(least * 8192, ANHYST_Q15_MAX * 8192);
}
#endif

#ifdef SMALL_BY_CONTRACT
static inline number decayed_share(int32_t t)
{
  SHOW(t >= 0);
  return any_within(0, UNIT);
}

static inline slope slope_of(table curve, number rise)
{
  SHOW(rise >= 0 && rise <= steepest(curve.n));
  return any_within(0, ANHYST_SLOPE_MAX);
}

static inline slope irreversible_slope(number above, entry steepness)
{
  SHOW(steepness > 0 && above >= -2 * UNIT && above <= 2 * UNIT);
  return any_within(-262144, 262144);
}

static inline slope mixed_slope(slope y_slope, slope x_slope, entry part)
{
  SHOW(part >= 0 && is_slope(y_slope) && is_slope(x_slope));
  return any_within(0, ANHYST_SLOPE_MAX);
}

static inline number quotient(number n, number d)
{
  SHOW(d > 0 && n >= 0);
  return any_within(0, 4 * UNIT - 1);
}
#endif

#ifdef CURVE_BY_CONTRACT
static number guess_along_curve(const branch_path *path, const equation *eq, number x,
                                number residual)
{
  SHOW(is_in_unit_range(x) && is_equation(eq) && residual > -2 * UNIT && residual < 2 * UNIT);
  return any_within(-UNIT, UNIT - 1);
}
#endif

#ifdef STEPS_BY_CONTRACT
static inline path_point evaluate(const branch_path *path, number x)
{
  SHOW(is_in_unit_range(x) && has_departed(path));
  path_point point = any_answer(path);
  ASSUME(point.x == x);
  return point;
}

static number guess_after_hold(const branch_path *path, const equation *eq, number end,
                               interval *within)
{
  SHOW(is_in_unit_range(end) && is_equation(eq) && within->low <= end && end <= within->high);
  if (nondet_i16() != 0) {
    within->low = end;
  } else {
    within->high = end;
  }
  return any_within(within->low, within->high);
}

static number guess_after_rejection(const branch_path *path, const equation *eq,
                                    const interval *within, number x, number residual,
                                    int was_rejected)
{
  SHOW(is_in_unit_range(x) && is_equation(eq) && residual > -2 * UNIT && residual < 2 * UNIT);
  SHOW(within->low <= within->high && is_in_unit_range(within->low) &&
       is_in_unit_range(within->high));
  return any_within(within->low, within->high);
}

static inline void follow_tangent(const branch_path *path, number goal, path_point *point)
{
  SHOW(is_in_unit_range(goal));
  *point = any_answer(path);
}
#endif

#ifdef RISE_BY_CONTRACT
static int search_path(const branch_path *path, const equation *eq, const equation *limit,
                       path_point *found)
{
  SHOW(has_begun(path) && has_departed(path) && is_in_unit_range(found->x) && found->x >= path->x);
  SHOW(is_in_unit_range(found->m) && is_slope(found->m_slope) && is_equation(eq));
  SHOW(limit == 0 || is_equation(limit));
  *found = any_answer(path);
  return nondet_i16();
}
#endif

#ifdef REMEMBER_BY_CONTRACT
static inline void store_step(compensator *c, const branch_path *path, mirror_type mirror,
                              const path_point *point)
{
  SHOW(is_in_unit_range(point->x) && is_in_unit_range(point->y) && is_in_unit_range(point->p) &&
       is_in_unit_range(point->m));
  SHOW(is_slope(point->y_slope) && is_slope(point->m_slope));
  c->next.memory.full = any_memory();
  c->next.memory.full.x = any_within(-UNIT, UNIT - 1) * 4;
  c->next.of.full.m = any_within(-UNIT, UNIT - 1);
}
#endif

#ifdef END_BY_CONTRACT
static int solve_from_last_step(compensator *c, number target)
{
  SHOW(target >= -3 * UNIT && target <= 3 * UNIT);
  c->next.memory.full = any_memory();
  c->next.memory.full.x = any_within(-UNIT, UNIT - 1) * 4;
  c->next.of.full.m = any_within(-UNIT, UNIT - 1);
  return nondet_i16();
}
#endif

#ifdef UNIT_BY_CONTRACT
/* This contract is proved in prove_block.c. */
static inline number convert_unit(number a, const entry *old_words, const entry *new_words,
                                  int16_t word)
{
  SHOW(a >= -ANHYST_Q30_ONE && a <= ANHYST_Q30_ONE);
  return nondet_i32();
}
#endif

#ifdef CARRIED_BY_CONTRACT
static number shift_state(branch_path *path, const entry *words, const old_state *from,
                          number shift, number flux)
{
  SHOW(is_in_unit_range(from->x) && is_in_unit_range(from->p) &&
       is_in_unit_range(from->anhysteretic_field));
  SHOW(from->inverse_error > -2 * UNIT && from->inverse_error < 2 * UNIT && shift >= -2 * UNIT &&
       shift <= 2 * UNIT);
  path->x = any_within(1 - UNIT, UNIT - 1);
  path->y = any_within(1 - UNIT, UNIT - 1);
  path->p = any_within(1 - UNIT, UNIT - 1);
  return nondet_i32();
}
#endif

/* ---- proofs ---- */

/* Proves an entry of any table in the block. */
static void prove_interpolate(void)
{
  int16_t words[ANHYST_BLOCK_MOST_WORDS]; /* any */
  const int32_t n = any_within(3, 10);
  const int32_t first = any_within(ANHYST_BLOCK_LEAST_WORDS, ANHYST_BLOCK_MOST_WORDS);
  ASSUME(first + (1 << n) + 1 <= ANHYST_BLOCK_MOST_WORDS);
  const table t = {words + first, (uint16_t)n};
  const int32_t u = any_within(0, UNIT - 1);
  const int32_t i = first + (u >> (28 - n));
  int32_t rise;
  ASSUME(words[i] >= -ANHYST_Q15_MAX && words[i] <= words[i + 1]);
  ASSUME(words[i + 1] - words[i] <= ANHYST_Q15_MAX);
  (void)interpolate(t, u, &rise);
  SHOW(rise == words[i + 1] - words[i]);
}

static void prove_decayed_share(void)
{
  const int32_t decayed = decayed_share(any_within(0, ANHYST_Q31_MAX));
  SHOW(decayed >= 0 && decayed <= UNIT);
}

static void prove_slopes(void)
{
  const branch_path path = any_path();
  const int32_t rise = any_within(0, steepest(path.curve.n));
  SHOW(is_slope(slope_of(path.curve, rise)));
  const int32_t anhysteretic_m =
      irreversible_slope(any_within(-2 * UNIT, 2 * UNIT), path.steepness);
  SHOW(anhysteretic_m >= -262144 && anhysteretic_m <= 262144);
}

static void prove_quotient(void)
{
  const int32_t found = quotient(any_within(0, ANHYST_Q31_MAX), any_within(1, ANHYST_Q31_MAX));
  SHOW(found >= 0 && found < 4 * UNIT);
}

static void prove_evaluate(void)
{
  const branch_path path = any_path();
  const int32_t x = any_within(-UNIT, UNIT - 1);
  const path_point point = evaluate(&path, x);
  SHOW(point.x == x);
  SHOW(is_answer(&path, &point));
}

static void prove_find_departure(void)
{
  const anhyst_full_memory from = any_memory();
  const mirror_type mirror = nondet_i16() != 0 ? -1 : 0;
  branch_path path;
  path_point point = {0, 0, 0, any_within(-UNIT, UNIT - 1), 0, 0};
  fill_words(block_words);
  init_branch_path(&path, block_words, &from, mirror);
  SHOW(has_begun(&path));
  find_departure(&path, block_words, &from, mirror);
  SHOW(has_departed(&path) && path.kappa >= 0 && path.kappa <= UNIT);
  find_start_slopes(&path, any_within(0, steepest(path.curve.n)), &point);
  SHOW(is_slope(point.y_slope) && is_slope(point.m_slope));
}

static void prove_newton_step(void)
{
  const branch_path path = any_path();
  path_point point = any_answer(&path);
  const equation eq = any_equation();
  const int32_t residual = left_side(&eq, point.x, point.m) - eq.target;
  SHOW(residual > -2 * UNIT && residual < 2 * UNIT);
  const int32_t step = step_against(residual, left_side_slope(&eq, point.m_slope));
  SHOW(step > -4 * UNIT && step < 4 * UNIT);
  follow_tangent(&path, any_within(-UNIT, UNIT - 1), &point);
  SHOW(is_answer(&path, &point));
}

static void prove_guess_along_curve(void)
{
  const branch_path path = any_path();
  const equation eq = any_equation();
  const int32_t x = any_within(-UNIT, UNIT - 1);
  SHOW(is_in_unit_range(guess_along_curve(&path, &eq, x, any_within(1 - 2 * UNIT, 2 * UNIT - 1))));
}

static void prove_other_guesses(void)
{
  const branch_path path = any_path();
  const equation eq = any_equation();
  const int32_t end = any_within(-UNIT, UNIT - 1);
  interval within = {any_within(-UNIT, end), any_within(end, UNIT - 1)};
  const interval before = within;
  const int32_t first = guess_after_hold(&path, &eq, end, &within);
  SHOW((within.low == end && within.high == before.high) ||
       (within.low == before.low && within.high == end));
  SHOW(first >= within.low && first <= within.high);
  const int32_t other = guess_after_rejection(&path, &eq, &before, any_within(-UNIT, UNIT - 1),
                                              any_within(1 - 2 * UNIT, 2 * UNIT - 1), nondet_i16());
  SHOW(other >= before.low && other <= before.high);
}

static void prove_search_path(void)
{
  const branch_path path = any_path();
  const equation eq = any_equation();
  const equation limit = any_equation();
  path_point point = any_answer(&path);
  ASSUME(point.x >= path.x);
  (void)search_path(&path, &eq, nondet_i16() != 0 ? &limit : 0, &point);
  SHOW(is_answer(&path, &point));
}

static int is_memory(const anhyst_full_memory *memory)
{
  return memory->x >= -ANHYST_Q30_ONE && memory->x < ANHYST_Q30_ONE &&
         memory->y >= -ANHYST_Q30_ONE && memory->y < ANHYST_Q30_ONE &&
         memory->p >= -ANHYST_Q30_ONE && memory->p < ANHYST_Q30_ONE;
}

static void prove_store_step(void)
{
  const branch_path path = any_path();
  const path_point point = any_answer(&path);
  anhyst_compensator c;
  c.memory.full = any_memory();
  store_step(&c, &path, nondet_i16() != 0 ? -1 : 0, &point);
  SHOW(is_memory(&c.next.memory.full));
  SHOW(is_slope(c.next.of.full.y_slope) && is_slope(c.next.of.full.m_slope));
}

static void prove_shift_state(void)
{
  branch_path path = any_path();
  const old_state from = {any_within(1 - UNIT, UNIT - 1), any_within(1 - UNIT, UNIT - 1),
                          any_within(1 - UNIT, UNIT - 1), any_within(1 - 2 * UNIT, 2 * UNIT - 1)};
  fill_words(block_words);
  (void)shift_state(&path, block_words, &from, any_within(-2 * UNIT, 2 * UNIT),
                    any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(is_in_unit_range(path.x) && is_in_unit_range(path.y) && is_in_unit_range(path.p));
  SHOW(path.x - path.p <= path.play && path.p - path.x <= path.play);
}

static void prove_transfer_state(void)
{
  int16_t words[INVERSE_AT + 1];
  fill_words(block_words);
  fill_words(words);
  anhyst_compensator c;
  c.words = block_words;
  c.memory.full = any_memory();
  transfer_state(&c, words, any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(is_memory(&c.memory.full));
}

/* Returns any compensator before a call of its kernel. */
static anhyst_compensator any_compensator(void)
{
  anhyst_compensator c;
  const anhyst_arms arms = {any_within(-ANHYST_Q30_ONE / 2, ANHYST_Q30_ONE / 2),
                            (int16_t)any_within(-ANHYST_Q15_MAX, ANHYST_Q15_MAX),
                            (int16_t)any_within(1, ANHYST_Q15_MAX)};
  fill_words(block_words);
  c.words = block_words;
  c.arms = arms;
  c.stage = nondet_u16();
  c.memory.full = any_memory();
  c.next.memory.full = any_memory();
  c.next.of.full.m = nondet_i32();
  c.next.of.full.y_slope = nondet_i16();
  c.next.of.full.m_slope = nondet_i16();
  c.next.of.full.direction = nondet_i16();
  return c;
}

static void prove_solve_from_last_step(void)
{
  anhyst_compensator c = any_compensator();
  (void)solve_from_last_step(&c, any_within(-3 * UNIT, 3 * UNIT));
}

static void prove_field(void)
{
  anhyst_compensator c = any_compensator();
  c.flux = any_within(-ANHYST_Q30_ONE / 2 * 3, ANHYST_Q30_ONE / 2 * 3);
  const int32_t found = field_for_flux(&c);
  SHOW(found >= -ANHYST_Q30_ONE && found < ANHYST_Q30_ONE);
}

static void prove_flux(void)
{
  anhyst_compensator c = any_compensator();
  (void)flux_for_current(&c, nondet_i32());
}

int main(void)
{
  PART();
  return 0;
}
