/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel of the full law, function by function from the leaves to the whole step. PART names
   the function that is proved; those below it are replaced by what their own proof has shown
   (contracts in proofs.toml), each of them first showing that it may be called so.

   Where a table is read, the words of the block are any that anhyst_block_check lets through. */
#ifndef RAW_PRODUCTS
#define ANHYST_PORT_HEADER "contracts.h"
#endif
#include "any.h"

/* The search turns as often as the block says, up to 16 times. In its proof, proofs.toml puts
   ANY_TURN at the beginning of a turn and NEXT_TURN at its end: the invariant is shown, everything
   forgotten but the invariant, and so one turn stands for all. */
#define INVARIANT                                                                                  \
  (along->x <= within.low && within.low <= next && next <= within.high && within.high < UNIT &&    \
   last_step >= 0)
#define ANY_TURN                                                                                   \
  SHOW(INVARIANT);                                                                                 \
  left = any_within(1, 16);                                                                        \
  within.low = nondet_i32();                                                                       \
  within.high = nondet_i32();                                                                      \
  last_step = nondet_i32();                                                                        \
  next = nondet_i32();                                                                             \
  is_stuck = nondet_i16();                                                                         \
  if (limit != 0 && nondet_i16() != 0) {                                                           \
    of = limit;                                                                                    \
  }                                                                                                \
  ASSUME(INVARIANT);
#define NEXT_TURN                                                                                  \
  SHOW(INVARIANT);                                                                                 \
  ASSUME(0);

#define inside(a) ((a) >= -UNIT && (a) < UNIT)

/* The iron's weight in the search, of either sign, or below zero alone where a fault shows there.
 */
#ifdef AGAINST_THE_AIR
#define MOST_IRON (-1)
#else
#define MOST_IRON ANHYST_Q15_MAX
#endif

#include "compensator/full.c"

/* The tables of a path; what stands in for value() tells them by their place. */
enum { CURVE_AT = ANHYST_BLOCK_LEAST_WORDS, BRANCH_AT, INVERSE_AT };
static int16_t block_words[INVERSE_AT + 1];
static const int16_t *const curve_words = block_words + CURVE_AT;
static const int16_t *const branch_words = block_words + BRANCH_AT;
static const int16_t *const inverse_words = block_words + INVERSE_AT;

static int32_t steepest(uint16_t n) { return ANHYST_Q15_MAX >> (n > 5U ? n - 5U : 0U); }

/* The head of a block that passed its check; no table is read. */
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

/* A path as begin() makes it. */
static int has_begun(const path *along)
{
  return inside(along->x) && inside(along->y) && inside(along->p) && along->play >= 0 &&
         along->play <= UNIT && along->tangent_step >= 0 && along->tangent_step <= MAX_TANGENT_STEP;
}

static int departed(const path *along)
{
  return inside(along->departure) && along->offset > -2 * UNIT && along->offset < 2 * UNIT;
}

/* The path as depart() leaves it. */
static path any_path(void)
{
  path along;
  along.x = nondet_i32();
  along.y = nondet_i32();
  along.p = nondet_i32();
  along.play = nondet_i32();
  along.tangent_step = nondet_i32();
  along.curve.at = curve_words;
  along.curve.n = (uint16_t)any_within(3, 9);
  along.branch.at = branch_words;
  along.branch.n = (uint16_t)(along.curve.n + 1U);
  along.inverse.at = inverse_words;
  along.inverse.n = (uint16_t)any_within(3, 9);
  along.fades.rate = (int16_t)any_within(1, ANHYST_Q15_MAX);
  along.fades.shift = (uint16_t)any_within(0, 12);
  along.turn = any_within(-UNIT, UNIT - 1);
  along.level = any_within(-UNIT, UNIT - 1);
  along.departure = nondet_i32();
  along.offset = nondet_i32();
  along.kappa = any_within(0, UNIT);
  along.lead = nondet_i16();
  along.steepness = (int16_t)any_within(1, ANHYST_Q15_MAX);
  along.reversible = (int16_t)any_within(0, ANHYST_Q15_MAX);
  along.evaluations = (int16_t)any_within(2, 16);
  ASSUME(has_begun(&along) && departed(&along));
  return along;
}

static int is_slope(int32_t slope) { return slope >= 0 && slope <= ANHYST_SLOPE_MAX; }

static int is_answer(const path *along, const answer *at)
{
  return inside(at->x) && inside(at->p) && at->p >= along->p && at->y >= along->y && at->y < UNIT &&
         inside(at->m) && is_slope(at->y_slope) && is_slope(at->m_slope);
}

static answer any_answer(const path *along)
{
  const answer at = {nondet_i32(), nondet_i32(), nondet_i32(),
                     nondet_i32(), nondet_i32(), nondet_i32()};
  ASSUME(is_answer(along, &at));
  return at;
}

static int is_equation(const equation *of)
{
  return of->air > 0 && of->iron >= -ANHYST_Q15_MAX && inside(of->target);
}

static equation any_equation(void)
{
  const equation of = {(int16_t)any_within(1, ANHYST_Q15_MAX),
                       (int16_t)any_within(-ANHYST_Q15_MAX, MOST_IRON),
                       any_within(-UNIT, UNIT - 1)};
  return of;
}

/* ---- contracts ---- */

#ifdef VALUE_BY_CONTRACT
static inline number value(table t, number u, number *rise)
{
  SHOW(u >= 0 && u < UNIT);
  const int32_t least = t.at == branch_words ? -ANHYST_Q15_MAX : 0;
  const uint16_t n = t.at == branch_words ? (uint16_t)(t.n - 1U) : t.n;
  *rise = any_within(0, t.at == inverse_words ? ANHYST_Q15_MAX : steepest(n));
  return any_within(least * 8192, ANHYST_Q15_MAX * 8192);
}
#endif

#ifdef SMALL_BY_CONTRACT
static inline number forgotten(int32_t t)
{
  SHOW(t >= 0);
  return any_within(0, UNIT);
}

static inline slope slope_of(table curve, number rise)
{
  SHOW(rise >= 0 && rise <= steepest(curve.n));
  return any_within(0, ANHYST_SLOPE_MAX);
}

static inline slope pulled(number above, entry steepness)
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
static number follow_curve(const path *along, const equation *of, number x, number residual)
{
  SHOW(inside(x) && is_equation(of) && residual > -2 * UNIT && residual < 2 * UNIT);
  return any_within(-UNIT, UNIT - 1);
}
#endif

#ifdef STEPS_BY_CONTRACT
static inline answer evaluate(const path *along, number x)
{
  SHOW(inside(x) && departed(along));
  answer at = any_answer(along);
  ASSUME(at.x == x);
  return at;
}

static number leave_hold(const path *along, const equation *of, number end, interval *within)
{
  SHOW(inside(end) && is_equation(of) && within->low <= end && end <= within->high);
  if (nondet_i16() != 0) {
    within->low = end;
  } else {
    within->high = end;
  }
  return any_within(within->low, within->high);
}

static number look_elsewhere(const path *along, const equation *of, const interval *within,
                             number x, number residual, int is_stuck)
{
  SHOW(inside(x) && is_equation(of) && residual > -2 * UNIT && residual < 2 * UNIT);
  SHOW(within->low <= within->high && inside(within->low) && inside(within->high));
  return any_within(within->low, within->high);
}

static inline void slide(const path *along, number goal, answer *at)
{
  SHOW(inside(goal));
  *at = any_answer(along);
}
#endif

#ifdef RISE_BY_CONTRACT
static int rise(const path *along, const equation *of, const equation *limit, answer *found)
{
  SHOW(has_begun(along) && departed(along) && inside(found->x) && found->x >= along->x);
  SHOW(inside(found->m) && is_slope(found->m_slope) && is_equation(of));
  SHOW(limit == 0 || is_equation(limit));
  *found = any_answer(along);
  return nondet_i16();
}
#endif

#ifdef REMEMBER_BY_CONTRACT
static inline void remember(compensator *c, const path *along, mirror way, const answer *at)
{
  SHOW(inside(at->x) && inside(at->y) && inside(at->p) && inside(at->m));
  SHOW(is_slope(at->y_slope) && is_slope(at->m_slope));
  c->next.memory.full = any_memory();
  c->next.memory.full.x = any_within(-UNIT, UNIT - 1) * 4;
  c->next.of.full.m = any_within(-UNIT, UNIT - 1);
}
#endif

#ifdef END_BY_CONTRACT
static int find_from_end(compensator *c, number wanted)
{
  SHOW(wanted >= -3 * UNIT && wanted <= 3 * UNIT);
  c->next.memory.full = any_memory();
  c->next.memory.full.x = any_within(-UNIT, UNIT - 1) * 4;
  c->next.of.full.m = any_within(-UNIT, UNIT - 1);
  return nondet_i16();
}
#endif

#ifdef UNIT_BY_CONTRACT
/* Proved in prove_block.c. */
static inline number convert_unit(number a, const entry *old_words, const entry *new_words,
                                  int16_t word)
{
  SHOW(a >= -ANHYST_Q30_ONE && a <= ANHYST_Q30_ONE);
  return nondet_i32();
}
#endif

#ifdef CARRIED_BY_CONTRACT
static number carried_to(path *along, const entry *words, const carried *from, number shift,
                         number flux)
{
  SHOW(inside(from->x) && inside(from->p) && inside(from->equal_field));
  SHOW(from->rest > -2 * UNIT && from->rest < 2 * UNIT && shift >= -2 * UNIT && shift <= 2 * UNIT);
  along->x = any_within(1 - UNIT, UNIT - 1);
  along->y = any_within(1 - UNIT, UNIT - 1);
  along->p = any_within(1 - UNIT, UNIT - 1);
  return nondet_i32();
}
#endif

/* ---- proofs ---- */

/* Any entry of any table within the block. */
static void prove_place(void)
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
  (void)value(t, u, &rise);
  SHOW(rise == words[i + 1] - words[i]);
}

static void prove_forgotten(void)
{
  const int32_t gone = forgotten(any_within(0, ANHYST_Q31_MAX));
  SHOW(gone >= 0 && gone <= UNIT);
}

static void prove_slopes(void)
{
  const path along = any_path();
  const int32_t rise = any_within(0, steepest(along.curve.n));
  SHOW(is_slope(slope_of(along.curve, rise)));
  const int32_t pull = pulled(any_within(-2 * UNIT, 2 * UNIT), along.steepness);
  SHOW(pull >= -262144 && pull <= 262144);
}

static void prove_quotient(void)
{
  const int32_t found = quotient(any_within(0, ANHYST_Q31_MAX), any_within(1, ANHYST_Q31_MAX));
  SHOW(found >= 0 && found < 4 * UNIT);
}

static void prove_evaluate(void)
{
  const path along = any_path();
  const int32_t x = any_within(-UNIT, UNIT - 1);
  const answer at = evaluate(&along, x);
  SHOW(at.x == x);
  SHOW(is_answer(&along, &at));
}

static void prove_depart(void)
{
  const anhyst_full_memory from = any_memory();
  const mirror way = nondet_i16() != 0 ? -1 : 0;
  path along;
  answer at = {0, 0, 0, any_within(-UNIT, UNIT - 1), 0, 0};
  fill_words(block_words);
  begin(&along, block_words, &from, way);
  SHOW(has_begun(&along));
  depart(&along, block_words, &from, way);
  SHOW(departed(&along) && along.kappa >= 0 && along.kappa <= UNIT);
  find_start_slopes(&along, any_within(0, steepest(along.curve.n)), &at);
  SHOW(is_slope(at.y_slope) && is_slope(at.m_slope));
}

static void prove_steps(void)
{
  const path along = any_path();
  answer at = any_answer(&along);
  const equation of = any_equation();
  const int32_t residual = sum_at(&of, at.x, at.m) - of.target;
  SHOW(residual > -2 * UNIT && residual < 2 * UNIT);
  const int32_t step = step_against(residual, sum_slope(&of, at.m_slope));
  SHOW(step > -4 * UNIT && step < 4 * UNIT);
  slide(&along, any_within(-UNIT, UNIT - 1), &at);
  SHOW(is_answer(&along, &at));
}

static void prove_curve(void)
{
  const path along = any_path();
  const equation of = any_equation();
  const int32_t x = any_within(-UNIT, UNIT - 1);
  SHOW(inside(follow_curve(&along, &of, x, any_within(1 - 2 * UNIT, 2 * UNIT - 1))));
}

static void prove_guesses(void)
{
  const path along = any_path();
  const equation of = any_equation();
  const int32_t end = any_within(-UNIT, UNIT - 1);
  interval within = {any_within(-UNIT, end), any_within(end, UNIT - 1)};
  const interval before = within;
  const int32_t first = leave_hold(&along, &of, end, &within);
  SHOW((within.low == end && within.high == before.high) ||
       (within.low == before.low && within.high == end));
  SHOW(first >= within.low && first <= within.high);
  const int32_t other = look_elsewhere(&along, &of, &before, any_within(-UNIT, UNIT - 1),
                                       any_within(1 - 2 * UNIT, 2 * UNIT - 1), nondet_i16());
  SHOW(other >= before.low && other <= before.high);
}

static void prove_rise(void)
{
  const path along = any_path();
  const equation of = any_equation();
  const equation limit = any_equation();
  answer at = any_answer(&along);
  ASSUME(at.x >= along.x);
  (void)rise(&along, &of, nondet_i16() != 0 ? &limit : 0, &at);
  SHOW(is_answer(&along, &at));
}

static int is_memory(const anhyst_full_memory *memory)
{
  return memory->x >= -ANHYST_Q30_ONE && memory->x < ANHYST_Q30_ONE &&
         memory->y >= -ANHYST_Q30_ONE && memory->y < ANHYST_Q30_ONE &&
         memory->p >= -ANHYST_Q30_ONE && memory->p < ANHYST_Q30_ONE;
}

static void prove_remember(void)
{
  const path along = any_path();
  const answer at = any_answer(&along);
  anhyst_compensator c;
  c.memory.full = any_memory();
  remember(&c, &along, nondet_i16() != 0 ? -1 : 0, &at);
  SHOW(is_memory(&c.next.memory.full));
  SHOW(is_slope(c.next.of.full.y_slope) && is_slope(c.next.of.full.m_slope));
}

static void prove_carried(void)
{
  path along = any_path();
  const carried from = {any_within(1 - UNIT, UNIT - 1), any_within(1 - UNIT, UNIT - 1),
                        any_within(1 - UNIT, UNIT - 1), any_within(1 - 2 * UNIT, 2 * UNIT - 1)};
  fill_words(block_words);
  (void)carried_to(&along, block_words, &from, any_within(-2 * UNIT, 2 * UNIT),
                   any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(inside(along.x) && inside(along.y) && inside(along.p));
  SHOW(along.x - along.p <= along.play && along.p - along.x <= along.play);
}

static void prove_carry(void)
{
  int16_t words[INVERSE_AT + 1];
  fill_words(block_words);
  fill_words(words);
  anhyst_compensator c;
  c.words = block_words;
  c.memory.full = any_memory();
  carry(&c, words, any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(is_memory(&c.memory.full));
}

/* A compensator as a kernel finds it. */
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

static void prove_end(void)
{
  anhyst_compensator c = any_compensator();
  (void)find_from_end(&c, any_within(-3 * UNIT, 3 * UNIT));
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
