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
   ANY_TURN at the beginning and at the end of a turn: the invariant is shown, everything forgotten
   but the invariant, and so one turn stands for all. */
#define INVARIANT                                                                                  \
  (inside(at.x) && inside(find.low) && find.low <= at.x && at.x <= find.high && find.high < ONE && \
   furthest >= 0 && next > at.x - 4 * ONE && next < at.x + 4 * ONE && find.residual > -2 * ONE &&  \
   find.residual < 2 * ONE)
#define ANY_TURN                                                                                   \
  SHOW(INVARIANT);                                                                                 \
  at.x = nondet_i32();                                                                             \
  find.low = nondet_i32();                                                                         \
  find.high = nondet_i32();                                                                        \
  find.residual = nondet_i32();                                                                    \
  furthest = nondet_i32();                                                                         \
  next = nondet_i32();                                                                             \
  ASSUME(INVARIANT);

#define inside(a) ((a) >= -ONE && (a) < ONE)

/* The iron's weight in the search, of either sign, or below zero alone where a fault shows there.
 */
#ifdef AGAINST_THE_AIR
#define MOST_IRON (-1)
#else
#define MOST_IRON ANHYST_Q15_MAX
#endif

#include "compensator/full.c"
#include "compensator/full_block.c"

/* The tables of a path; what stands in for value() tells them by their place. */
enum { CURVE_AT = ANHYST_BLOCK_LEAST_WORDS, BRANCH_AT, INVERSE_AT };
static int16_t block_words[INVERSE_AT + 1];
static const int16_t *const curve_words = block_words + CURVE_AT;
static const int16_t *const branch_words = block_words + BRANCH_AT;
static const int16_t *const inverse_words = block_words + INVERSE_AT;

static int32_t steepest(uint16_t n) { return ANHYST_Q15_MAX >> (n > 5U ? n - 5U : 0U); }

/* The path as prepare() makes it. */
static path any_prepared(void)
{
  path along;
  block_words[ANHYST_WORD_FULL_BRANCH] = BRANCH_AT;
  block_words[ANHYST_WORD_FULL_INVERSE] = INVERSE_AT;
  block_words[ANHYST_WORD_FULL_INVERSE_SEGMENTS] = (int16_t)any_within(3, 9);
  block_words[ANHYST_WORD_FULL_RATE] = (int16_t)any_within(1, ANHYST_Q15_MAX);
  block_words[ANHYST_WORD_FULL_RATE_SHIFT] = (int16_t)any_within(0, 12);
  along.words = block_words;
  along.curve.at = curve_words;
  along.curve.n = (uint16_t)any_within(3, 9);
  along.x = any_within(-ONE, ONE - 1);
  along.y = any_within(-ONE, ONE - 1);
  along.p = any_within(-ONE, ONE - 1);
  along.turn = any_within(-ONE, ONE - 1);
  along.level = any_within(-ONE, ONE - 1);
  along.play = any_within(0, ANHYST_Q15_MAX) * 8192;
  along.steepness = (int16_t)any_within(1, ANHYST_Q15_MAX);
  along.reversible = (int16_t)any_within(0, ANHYST_Q15_MAX);
  along.near = any_within(0, NEAR_WAY);
  return along;
}

static int departed(const path *along)
{
  return inside(along->departure) && along->offset > -2 * ONE && along->offset < 2 * ONE;
}

/* The path as depart() leaves it. */
static path any_path(void)
{
  path along = any_prepared();
  along.branch.at = branch_words;
  along.branch.n = (uint16_t)(along.curve.n + 1U);
  along.inverse.at = inverse_words;
  along.inverse.n = (uint16_t)any_within(3, 9);
  along.rate = (int16_t)any_within(1, ANHYST_Q15_MAX);
  along.rate_shift = (uint16_t)any_within(0, 12);
  along.departure = nondet_i32();
  along.offset = nondet_i32();
  along.lead = nondet_i16();
  ASSUME(departed(&along));
  return along;
}

static int is_slope(int32_t slope) { return slope >= 0 && slope <= ANHYST_SLOPE_MAX; }

static int is_answer(const path *along, const answer *at)
{
  return inside(at->x) && inside(at->p) && at->p >= along->p && at->y >= along->y && at->y < ONE &&
         inside(at->m) && is_slope(at->y_slope) && is_slope(at->m_slope);
}

static answer any_answer(const path *along)
{
  const answer at = {nondet_i32(), nondet_i32(), nondet_i32(),
                     nondet_i32(), nondet_i32(), nondet_i32()};
  ASSUME(is_answer(along, &at));
  return at;
}

/* ---- contracts ---- */

#ifdef VALUE_BY_CONTRACT
static inline int32_t value(table t, int32_t u, int32_t *rise)
{
  SHOW(u >= 0 && u < ONE);
  const int32_t least = t.at == branch_words ? -ANHYST_Q15_MAX : 0;
  const uint16_t n = t.at == branch_words ? (uint16_t)(t.n - 1U) : t.n;
  *rise = any_within(0, t.at == inverse_words ? ANHYST_Q15_MAX : steepest(n));
  return any_within(least * 8192, ANHYST_Q15_MAX * 8192);
}
#endif

#ifdef SMALL_BY_CONTRACT
static int32_t forgotten(int32_t way)
{
  SHOW(way >= 0);
  return any_within(0, ONE);
}

static inline int32_t slope_of(const path *along, int32_t rise)
{
  SHOW(rise >= 0 && rise <= steepest(along->curve.n));
  return any_within(0, ANHYST_SLOPE_MAX);
}

static int32_t pulled(const path *along, int32_t above)
{
  SHOW(along->steepness > 0 && above >= -2 * ONE && above <= 2 * ONE);
  return any_within(-262144, 262144);
}

static inline int32_t slope_of_m(const path *along, int32_t y_slope, int32_t x_slope)
{
  SHOW(along->reversible >= 0 && is_slope(y_slope) && is_slope(x_slope));
  return any_within(0, ANHYST_SLOPE_MAX);
}

static int32_t quotient(int32_t n, int32_t d)
{
  SHOW(d > 0 && n >= 0 && n < 2 * ONE);
  return any_within(0, 4 * ONE - 1);
}
#endif

#ifdef STEPS_BY_CONTRACT
static void evaluate(const path *along, int32_t x, answer *at)
{
  SHOW(inside(x));
  SHOW(departed(along));
  *at = any_answer(along);
  ASSUME(at->x == x);
}

static int32_t look(search *find, const answer *at)
{
  SHOW(find->air > 0 && find->iron >= -ANHYST_Q15_MAX && inside(find->target));
  SHOW(inside(at->x) && inside(at->m) && is_slope(at->m_slope));
  find->residual = any_within(1 - 2 * ONE, 2 * ONE - 1);
  if (find->residual < 0) {
    find->low = at->x;
  } else {
    find->high = at->x;
  }
  return at->x - any_within(1 - 4 * ONE, 4 * ONE - 1);
}

static int32_t follow_curve(const path *along, const search *find, int32_t x, int32_t residual)
{
  SHOW(inside(x) && residual > -2 * ONE && residual < 2 * ONE);
  SHOW(find->air > 0 && find->iron >= -ANHYST_Q15_MAX);
  return any_within(-ONE, ONE - 1);
}

static int32_t leave_hold(const path *along, search *find, int32_t end, int32_t tangent)
{
  SHOW(inside(end) && inside(find->target) && find->low <= end && end <= find->high);
  SHOW(find->air > 0 && find->iron >= -ANHYST_Q15_MAX);
  if (nondet_i16() != 0) {
    find->low = end;
  } else {
    find->high = end;
  }
  return any_within(find->low, find->high);
}

static void slide(const path *along, int32_t x, answer *at)
{
  SHOW(inside(x));
  *at = any_answer(along);
}
#endif

#ifdef RISE_BY_CONTRACT
static answer rise(const path *along, search find, int16_t evaluations, answer at)
{
  SHOW(departed(along) && is_answer(along, &at));
  SHOW(find.air > 0 && find.iron >= -ANHYST_Q15_MAX && inside(find.target));
  return any_answer(along);
}

static int slid(const path *along, search find, answer *at)
{
  SHOW(is_answer(along, at));
  SHOW(find.air > 0 && find.iron >= -ANHYST_Q15_MAX && inside(find.target));
  *at = any_answer(along);
  return nondet_i16();
}
#endif

#ifdef REMEMBER_BY_CONTRACT
static void remember(const path *along, const anhyst_full_memory *from, int32_t falling,
                     const answer *at, anhyst_full_memory *to)
{
  SHOW(inside(at->x) && inside(at->y) && inside(at->p));
  SHOW(inside(along->turn) && inside(along->level));
  to->x = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE - 4);
  to->y = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE - 4);
  to->p = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE - 4);
  to->turn = nondet_i32();
  to->level = nondet_i32();
}
#endif

/* Proved in prove_block.c. */
int32_t anhyst_in_unit(int32_t a, const int16_t *before, const int16_t *words, int16_t word)
{
  SHOW(a >= -ANHYST_Q30_ONE && a <= ANHYST_Q30_ONE);
  return nondet_i32();
}

#ifdef CARRIED_BY_CONTRACT
static int32_t carried_to(path *along, const carried *from, int32_t way, int16_t air, int32_t flux)
{
  SHOW(inside(from->x) && inside(from->p) && inside(from->behind));
  SHOW(from->rest > -2 * ONE && from->rest < 2 * ONE && way >= -2 * ONE && way <= 2 * ONE);
  along->x = any_within(1 - ONE, ONE - 1);
  along->y = any_within(1 - ONE, ONE - 1);
  along->p = any_within(1 - ONE, ONE - 1);
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
  const int32_t u = any_within(0, ONE - 1);
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
  SHOW(gone >= 0 && gone <= ONE);
}

static void prove_slopes(void)
{
  const path along = any_path();
  const int32_t rise = any_within(0, steepest(along.curve.n));
  SHOW(is_slope(slope_of(&along, rise)));
  const int32_t pull = pulled(&along, any_within(-2 * ONE, 2 * ONE));
  SHOW(pull >= -262144 && pull <= 262144);
}

static void prove_quotient(void)
{
  const int32_t found = quotient(any_within(0, 2 * ONE - 1), any_within(1, ANHYST_Q31_MAX));
  SHOW(found >= 0 && found < 4 * ONE);
}

static void prove_evaluate(void)
{
  const path along = any_path();
  const int32_t x = any_within(-ONE, ONE - 1);
  answer at;
  evaluate(&along, x, &at);
  SHOW(at.x == x);
  SHOW(is_answer(&along, &at));
}

static void prove_depart(void)
{
  path along = any_prepared();
  int32_t x_rise;
  answer at = {along.x, along.y, along.p, any_within(-ONE, ONE - 1), 0, 0};
  set_out(&along, nondet_i16() != 0 ? -1 : 0);
  depart(&along);
  SHOW(departed(&along));
  at.x = along.x;
  at.y = along.y;
  at.p = along.p;
  rise_from_start(&along, odd_value(along.curve, along.x, &x_rise), x_rise, &at);
  SHOW(is_answer(&along, &at));
}

static void prove_steps(void)
{
  const path along = any_path();
  answer at = any_answer(&along);
  search find = {(int16_t)any_within(1, ANHYST_Q15_MAX),
                 (int16_t)any_within(-ANHYST_Q15_MAX, MOST_IRON),
                 any_within(-ONE, ONE - 1),
                 nondet_i32(),
                 nondet_i32(),
                 nondet_i32()};
  const int32_t x = at.x;
  const int32_t next = look(&find, &at);
  SHOW(find.residual > -2 * ONE && find.residual < 2 * ONE);
  SHOW(next - x > -4 * ONE && next - x < 4 * ONE);
  SHOW(find.residual < 0 ? find.low == x : find.high == x);
  SHOW(inside(follow_curve(&along, &find, x, find.residual)));
  const int32_t end = any_within(-ONE, ONE - 1);
  const int32_t low = any_within(-ONE, end);
  const int32_t high = any_within(end, ONE - 1);
  find.low = low;
  find.high = high;
  const int32_t first = leave_hold(&along, &find, end, next);
  SHOW((find.low == end && find.high == high) || (find.low == low && find.high == end));
  SHOW(first >= find.low && first <= find.high);
  slide(&along, any_within(-ONE, ONE - 1), &at);
  SHOW(is_answer(&along, &at));
}

static void prove_slid(void)
{
  const path along = any_path();
  answer at = any_answer(&along);
  const search find = {(int16_t)any_within(1, ANHYST_Q15_MAX),
                       (int16_t)any_within(-ANHYST_Q15_MAX, MOST_IRON),
                       any_within(-ONE, ONE - 1),
                       nondet_i32(),
                       nondet_i32(),
                       nondet_i32()};
  (void)slid(&along, find, &at);
  SHOW(is_answer(&along, &at));
}

static void prove_rise(void)
{
  const path along = any_path();
  answer at = any_answer(&along);
  search find = {(int16_t)any_within(1, ANHYST_Q15_MAX),
                 (int16_t)any_within(-ANHYST_Q15_MAX, MOST_IRON),
                 any_within(-ONE, ONE - 1),
                 nondet_i32(),
                 nondet_i32(),
                 nondet_i32()};
  ASSUME(at.x >= along.x);
  at = rise(&along, find, (int16_t)any_within(2, 16), at);
  SHOW(is_answer(&along, &at));
}

static void prove_remember(void)
{
  const path along = any_path();
  const answer at = any_answer(&along);
  const anhyst_full_memory from = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32()};
  anhyst_full_memory to;
  remember(&along, &from, nondet_i16() != 0 ? -1 : 0, &at, &to);
  SHOW(to.x >= -ANHYST_Q30_ONE && to.x < ANHYST_Q30_ONE);
  SHOW(to.y >= -ANHYST_Q30_ONE && to.y < ANHYST_Q30_ONE);
  SHOW(to.p >= -ANHYST_Q30_ONE && to.p < ANHYST_Q30_ONE);
}

/* The head of a block that passed its check. */
static void assume_valid(const int16_t *words)
{
  const int32_t air = words[ANHYST_WORD_FULL_AIR];
  const int32_t n = words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  const int32_t n_inverse = words[ANHYST_WORD_FULL_INVERSE_SEGMENTS];
  ASSUME(air > 0 && words[ANHYST_WORD_FULL_REVERSIBLE] >= 0 && words[ANHYST_WORD_FULL_PLAY] >= 0);
  ASSUME(words[ANHYST_WORD_FULL_RATE] > 0 && words[ANHYST_WORD_FULL_STEEPNESS] > 0);
  ASSUME(anhyst_within(words[ANHYST_WORD_FULL_RATE_SHIFT], 0, 12));
  ASSUME(anhyst_within(words[ANHYST_WORD_FULL_ITERATIONS], 2, 16));
  ASSUME(n >= 3 && n <= 9 && n_inverse >= 3 && n_inverse <= 9);
}

static void prove_carried(void)
{
  path along = any_prepared();
  const carried from = {any_within(1 - ONE, ONE - 1), any_within(1 - ONE, ONE - 1),
                        any_within(1 - ONE, ONE - 1), any_within(1 - 2 * ONE, 2 * ONE - 1)};
  (void)carried_to(&along, &from, any_within(-2 * ONE, 2 * ONE),
                   (int16_t)any_within(1, ANHYST_Q15_MAX),
                   any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(inside(along.x) && inside(along.y) && inside(along.p));
  SHOW(along.x - along.p <= along.play && along.p - along.x <= along.play);
}

static void prove_carry(void)
{
  int16_t before[ANHYST_BLOCK_LEAST_WORDS]; /* any; no table is read */
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  assume_valid(before);
  assume_valid(words);
  anhyst_compensator c;
  const anhyst_full_memory any = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32()};
  c.words = before;
  c.memory.full = any;
  anhyst_full_carry(&c, words, any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(c.memory.full.x > -ANHYST_Q30_ONE && c.memory.full.x < ANHYST_Q30_ONE);
  SHOW(c.memory.full.y > -ANHYST_Q30_ONE && c.memory.full.y < ANHYST_Q30_ONE);
  SHOW(c.memory.full.p > -ANHYST_Q30_ONE && c.memory.full.p < ANHYST_Q30_ONE);
}

static void prove_kernel(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS]; /* any; no table is read */
  assume_valid(words);
  const anhyst_full_memory from = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32()};
  anhyst_compensator c;
  c.words = words;
  c.memory.full = from;
#ifdef FIELD
  c.flux = any_within(-ANHYST_Q30_ONE / 2 * 3, ANHYST_Q30_ONE / 2 * 3);
  (void)full_field(&c);
  SHOW(is_slope(c.next.y_slope) && is_slope(c.next.m_slope));
#else
  const anhyst_candidate solved = {
      {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32()},
      nondet_i32(),
      0,
      nondet_i16(),
      (int16_t)any_within(0, ANHYST_SLOPE_MAX),
      (int16_t)any_within(0, ANHYST_SLOPE_MAX),
      0};
  const anhyst_arms arms = {any_within(-ANHYST_Q30_ONE / 2, ANHYST_Q30_ONE / 2),
                            (int16_t)any_within(-ANHYST_Q15_MAX, ANHYST_Q15_MAX),
                            (int16_t)any_within(1, ANHYST_Q15_MAX)};
  c.next = solved;
  c.arms = arms;
  (void)full_flux(&c, nondet_i32());
#endif
  const anhyst_full_memory to = c.next.memory.full;
  SHOW(to.x >= -ANHYST_Q30_ONE && to.x < ANHYST_Q30_ONE);
  SHOW(to.y >= -ANHYST_Q30_ONE && to.y < ANHYST_Q30_ONE);
  SHOW(to.p >= -ANHYST_Q30_ONE && to.p < ANHYST_Q30_ONE);
}

int main(void)
{
  PART();
  return 0;
}
