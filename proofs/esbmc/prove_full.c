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
  (path->x <= bracket.low && bracket.low <= next && next <= bracket.high && bracket.high < ONE &&  \
   last_step >= 0)
#define BEGIN_ANY_ITERATION                                                                        \
  SHOW(INVARIANT);                                                                                 \
  evaluations_left = any_within(1, 16);                                                            \
  bracket.low = nondet_i32();                                                                      \
  bracket.high = nondet_i32();                                                                     \
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

#define is_in_unit_range(a) ((a) >= -ONE && (a) < ONE)

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
         path->threshold >= 0 && path->threshold <= ONE && path->tangent_step >= 0 &&
         path->tangent_step <= MAX_TANGENT_STEP;
}

static int has_departed(const branch_path *path)
{
  return is_in_unit_range(path->y_start) && path->offset > -2 * ONE && path->offset < 2 * ONE;
}

/* Returns any path after find_y_start(). */
static branch_path any_path(void)
{
  branch_path path;
  path.x = nondet_i32();
  path.y = nondet_i32();
  path.p = nondet_i32();
  path.threshold = nondet_i32();
  path.tangent_step = nondet_i32();
  path.curve.entries = curve_words;
  path.curve.log2_segments = (uint16_t)any_within(3, 9);
  path.branch.entries = branch_words;
  path.branch.log2_segments = (uint16_t)(path.curve.log2_segments + 1U);
  path.inverse.entries = inverse_words;
  path.inverse.log2_segments = (uint16_t)any_within(3, 9);
  path.decay.rate = (int16_t)any_within(1, ANHYST_Q15_MAX);
  path.decay.shift = (uint16_t)any_within(0, 12);
  path.reversal_play = any_within(-ONE, ONE - 1);
  path.reversal_y = any_within(-ONE, ONE - 1);
  path.y_start = nondet_i32();
  path.offset = nondet_i32();
  path.kappa = any_within(0, ONE);
  path.offset_weight = nondet_i16();
  path.steepness = (int16_t)any_within(1, ANHYST_Q15_MAX);
  path.reversible = (int16_t)any_within(0, ANHYST_Q15_MAX);
  path.max_evaluations = (int16_t)any_within(2, 16);
  ASSUME(has_begun(&path) && has_departed(&path));
  return path;
}

static int is_slope(int32_t slope) { return slope >= 0 && slope <= ANHYST_MAX_SLOPE; }

static int is_answer(const branch_path *path, const path_point *point)
{
  return is_in_unit_range(point->x) && is_in_unit_range(point->p) && point->p >= path->p &&
         point->y >= path->y && point->y < ONE && is_in_unit_range(point->m) &&
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
                       any_within(-ONE, ONE - 1)};
  return eq;
}

/* ---- contracts ---- */

#ifdef VALUE_BY_CONTRACT
static inline number interpolate(table t, number u, number *rise)
{
  SHOW(u >= 0 && u < ONE);
  const int32_t least = t.entries == branch_words ? -ANHYST_Q15_MAX : 0;
  const uint16_t n = t.entries == branch_words ? (uint16_t)(t.log2_segments - 1U) : t.log2_segments;
  *rise = any_within(0, t.entries == inverse_words ? ANHYST_Q15_MAX : steepest(n));
  return any_within(least * 8192, ANHYST_Q15_MAX * 8192);
}
#endif

#ifdef SMALL_BY_CONTRACT
static inline number decayed_fraction(int32_t t)
{
  SHOW(t >= 0);
  return any_within(0, ONE);
}

static inline slope curve_slope(table curve, number rise)
{
  SHOW(rise >= 0 && rise <= steepest(curve.log2_segments));
  return any_within(0, ANHYST_MAX_SLOPE);
}

static inline slope irreversible_slope(number above, entry steepness)
{
  SHOW(steepness > 0 && above >= -2 * ONE && above <= 2 * ONE);
  return any_within(-262144, 262144);
}

static inline slope total_m_slope(slope y_slope, slope x_slope, entry part)
{
  SHOW(part >= 0 && is_slope(y_slope) && is_slope(x_slope));
  return any_within(0, ANHYST_MAX_SLOPE);
}

static inline number quotient(number n, number d)
{
  SHOW(d > 0 && n >= 0);
  return any_within(0, 4 * ONE - 1);
}
#endif

#ifdef CURVE_BY_CONTRACT
static number guess_along_curve(const branch_path *path, const equation *eq, number x,
                                number residual)
{
  SHOW(is_in_unit_range(x) && is_equation(eq) && residual > -2 * ONE && residual < 2 * ONE);
  return any_within(-ONE, ONE - 1);
}
#endif

#ifdef STEPS_BY_CONTRACT
static inline path_point evaluate_path(const branch_path *path, number x)
{
  SHOW(is_in_unit_range(x) && has_departed(path));
  path_point point = any_answer(path);
  ASSUME(point.x == x);
  return point;
}

static number guess_after_constant_y(const branch_path *path, const equation *eq, number end,
                                     interval *bracket)
{
  SHOW(is_in_unit_range(end) && is_equation(eq) && bracket->low <= end && end <= bracket->high);
  if (nondet_i16() != 0) {
    bracket->low = end;
  } else {
    bracket->high = end;
  }
  return any_within(bracket->low, bracket->high);
}

static number guess_after_rejection(const branch_path *path, const equation *eq,
                                    const interval *bracket, number x, number residual,
                                    int was_rejected)
{
  SHOW(is_in_unit_range(x) && is_equation(eq) && residual > -2 * ONE && residual < 2 * ONE);
  SHOW(bracket->low <= bracket->high && is_in_unit_range(bracket->low) &&
       is_in_unit_range(bracket->high));
  return any_within(bracket->low, bracket->high);
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
  c->next.memory.full.x = any_within(-ONE, ONE - 1) * 4;
  c->next.of.full.m = any_within(-ONE, ONE - 1);
}
#endif

#ifdef END_BY_CONTRACT
static int solve_from_last_step(compensator *c, number target)
{
  SHOW(target >= -3 * ONE && target <= 3 * ONE);
  c->next.memory.full = any_memory();
  c->next.memory.full.x = any_within(-ONE, ONE - 1) * 4;
  c->next.of.full.m = any_within(-ONE, ONE - 1);
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
  SHOW(from->inverse_error > -2 * ONE && from->inverse_error < 2 * ONE && shift >= -2 * ONE &&
       shift <= 2 * ONE);
  path->x = any_within(1 - ONE, ONE - 1);
  path->y = any_within(1 - ONE, ONE - 1);
  path->p = any_within(1 - ONE, ONE - 1);
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
  const int32_t u = any_within(0, ONE - 1);
  const int32_t i = first + (u >> (28 - n));
  int32_t rise;
  ASSUME(words[i] >= -ANHYST_Q15_MAX && words[i] <= words[i + 1]);
  ASSUME(words[i + 1] - words[i] <= ANHYST_Q15_MAX);
  (void)interpolate(t, u, &rise);
  SHOW(rise == words[i + 1] - words[i]);
}

static void prove_decayed_share(void)
{
  const int32_t decayed = decayed_fraction(any_within(0, ANHYST_Q31_MAX));
  SHOW(decayed >= 0 && decayed <= ONE);
}

static void prove_slopes(void)
{
  const branch_path path = any_path();
  const int32_t rise = any_within(0, steepest(path.curve.log2_segments));
  SHOW(is_slope(curve_slope(path.curve, rise)));
  const int32_t anhysteretic_m = irreversible_slope(any_within(-2 * ONE, 2 * ONE), path.steepness);
  SHOW(anhysteretic_m >= -262144 && anhysteretic_m <= 262144);
}

static void prove_quotient(void)
{
  const int32_t found = quotient(any_within(0, ANHYST_Q31_MAX), any_within(1, ANHYST_Q31_MAX));
  SHOW(found >= 0 && found < 4 * ONE);
}

static void prove_evaluate(void)
{
  const branch_path path = any_path();
  const int32_t x = any_within(-ONE, ONE - 1);
  const path_point point = evaluate_path(&path, x);
  SHOW(point.x == x);
  SHOW(is_answer(&path, &point));
}

static void prove_find_departure(void)
{
  const anhyst_full_memory from = any_memory();
  const mirror_type mirror = nondet_i16() != 0 ? -1 : 0;
  branch_path path;
  path_point point = {0, 0, 0, any_within(-ONE, ONE - 1), 0, 0};
  fill_words(block_words);
  init_branch_path(&path, block_words, &from, mirror);
  SHOW(has_begun(&path));
  find_y_start(&path, block_words, &from, mirror);
  SHOW(has_departed(&path) && path.kappa >= 0 && path.kappa <= ONE);
  find_start_slopes(&path, any_within(0, steepest(path.curve.log2_segments)), &point);
  SHOW(is_slope(point.y_slope) && is_slope(point.m_slope));
}

static void prove_newton_step(void)
{
  const branch_path path = any_path();
  path_point point = any_answer(&path);
  const equation eq = any_equation();
  const int32_t residual = left_side(&eq, point.x, point.m) - eq.target;
  SHOW(residual > -2 * ONE && residual < 2 * ONE);
  const int32_t step = newton_step(residual, left_side_slope(&eq, point.m_slope));
  SHOW(step > -4 * ONE && step < 4 * ONE);
  follow_tangent(&path, any_within(-ONE, ONE - 1), &point);
  SHOW(is_answer(&path, &point));
}

static void prove_guess_along_curve(void)
{
  const branch_path path = any_path();
  const equation eq = any_equation();
  const int32_t x = any_within(-ONE, ONE - 1);
  SHOW(is_in_unit_range(guess_along_curve(&path, &eq, x, any_within(1 - 2 * ONE, 2 * ONE - 1))));
}

static void prove_other_guesses(void)
{
  const branch_path path = any_path();
  const equation eq = any_equation();
  const int32_t end = any_within(-ONE, ONE - 1);
  interval bracket = {any_within(-ONE, end), any_within(end, ONE - 1)};
  const interval before = bracket;
  const int32_t first = guess_after_constant_y(&path, &eq, end, &bracket);
  SHOW((bracket.low == end && bracket.high == before.high) ||
       (bracket.low == before.low && bracket.high == end));
  SHOW(first >= bracket.low && first <= bracket.high);
  const int32_t other = guess_after_rejection(&path, &eq, &before, any_within(-ONE, ONE - 1),
                                              any_within(1 - 2 * ONE, 2 * ONE - 1), nondet_i16());
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
  const old_state from = {any_within(1 - ONE, ONE - 1), any_within(1 - ONE, ONE - 1),
                          any_within(1 - ONE, ONE - 1), any_within(1 - 2 * ONE, 2 * ONE - 1)};
  fill_words(block_words);
  (void)shift_state(&path, block_words, &from, any_within(-2 * ONE, 2 * ONE),
                    any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(is_in_unit_range(path.x) && is_in_unit_range(path.y) && is_in_unit_range(path.p));
  SHOW(path.x - path.p <= path.threshold && path.p - path.x <= path.threshold);
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
  (void)solve_from_last_step(&c, any_within(-3 * ONE, 3 * ONE));
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
