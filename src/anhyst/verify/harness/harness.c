/* SPDX-License-Identifier: Apache-2.0 */
/* Runs the compensator through steps of its own making and folds every output into a hash.

   The same source runs on every target. Inputs come from a generator that is made of unsigned
   32-bit arithmetic alone, so that all targets see the same ones; nothing here relies on the width
   of int. */
#include "harness.h"

#include "anhyst/pidd2.h"
#include "signals.h"

#define PHASE_STEPS 128U
#define Q30_ONE ((int32_t)1073741824)
#define PAINT 0xA5U
#define PAINTED_BYTES 1024U

volatile harness_box_layout harness_box;

/* What the generator is at: q30 within -1..1, so that sums of two cannot overflow. */
typedef struct {
  uint32_t random;
  int32_t demand;
  int32_t gap;
  int32_t target;   /* of the nested loops */
  uint32_t demands; /* kind of demand in this phase */
  uint32_t gaps;    /* kind of gap in this phase */
} generator;

typedef struct {
  signal demand, gap, applied, applied_gap;
  uint32_t how;
  int32_t reference, position, load; /* of the position controller, q31 */
} input;

static compensator_state compensator;
static generator inputs;

/* Gains of the size a levitated mass at some 10 kHz has; with inputs over the full range every
   term saturates now and then. */
static const anhyst_pidd2_gains_q31 gains = {{20000, 1},  {24000, -6}, {-30000, 5}, {-17000, 6},
                                             {16384, -2}, {20000, -4}, {-28000, 0}, {-20000, 0},
                                             -8000,       0,           -2000000000, 2000000000};
static anhyst_pidd2_state_q31 controller;

/* xorshift32: 1 .. 2^32 - 1. */
static uint32_t draw(void)
{
  uint32_t x = inputs.random;
  x ^= x << 13;
  x ^= x >> 17;
  x ^= x << 5;
  inputs.random = x;
  return x;
}

/* The number whose two's complement is u, without leaving it to the compiler. */
static int32_t as_signed(uint32_t u)
{
  return u <= 0x7FFFFFFFU ? (int32_t)u : -(int32_t)(0xFFFFFFFFU - u) - 1;
}

/* Uniform over q30 -1..1, shifted right by n. */
static int32_t draw_q30(uint16_t n)
{
  const int32_t r = (int32_t)(draw() >> 1) - Q30_ONE;
  return r / (int32_t)((uint32_t)1 << n);
}

static int32_t within(int32_t a, int32_t low, int32_t high)
{
  if (a < low) {
    return low;
  }
  return a > high ? high : a;
}

/* q31 of a q30 within -1..1; 1.0 becomes the largest number. */
static int32_t double_q30(int32_t a) { return a >= Q30_ONE ? INT32_MAX : a * 2; }

/* Loops inside one another: runs to a target, then to one on the other side, nearer to zero. */
static int32_t nested(int32_t demand)
{
  const int32_t stride = Q30_ONE / 24;
  const int32_t left = inputs.target / 2 - demand / 2;
  if (left < stride / 2 && left > -(stride / 2)) {
    const int32_t at = inputs.target;
    inputs.target = -(at - at / 8);
    if (at < Q30_ONE / 64 && at > -(Q30_ONE / 64)) {
      inputs.target = Q30_ONE;
    }
    return at;
  }
  return demand + (left > 0 ? stride : -stride);
}

static int32_t next_demand(int32_t demand)
{
  switch (inputs.demands) {
  case 0: /* random walk, slow */
    return demand + draw_q30(8);
  case 1: /* random walk, fast */
    return demand + draw_q30(3);
  case 2: /* jumps over the full range */
    return draw_q30(0);
  case 3: /* nested loops */
    return nested(demand);
  case 4: /* reversals about a drifting place */
    return inputs.target / 2 + draw_q30(5);
  default: /* a ramp that turns at random, then and now between the ends */
    if (draw() % 64 == 0) {
      inputs.target = -inputs.target;
    }
    return demand + inputs.target / 64;
  }
}

static int32_t next_gap(int32_t gap)
{
  switch (inputs.gaps) {
  case 0:
    return gap;
  case 1:
    return gap + draw_q30(9);
  default:
    return draw_q30(0); /* half of them below the range */
  }
}

/* What was applied when it is not what was solved: another current, another gap, or both. */
static void choose_applied(input *in)
{
  const uint32_t kind = draw() % 16;
  const int32_t applied = kind < 13 ? as_signed(draw()) : double_q30(draw_q30(4));
  in->how = kind < 11 ? HARNESS_AS_SOLVED : HARNESS_AS_GIVEN;
  in->applied = current_of(applied);
  in->applied_gap = kind == 15 ? gap_of(double_q30(within(draw_q30(0), 0, Q30_ONE))) : in->gap;
  in->load = applied / 8;
}

static void next_input(uint32_t step, input *in)
{
  if (step % PHASE_STEPS == 0) {
    inputs.demands = draw() % 6;
    inputs.gaps = draw() % 4 < 3 ? draw() % 2 : 2;
    inputs.target = draw_q30(0);
  }
  inputs.demand = within(next_demand(inputs.demand), -Q30_ONE, Q30_ONE);
  inputs.gap = within(next_gap(inputs.gap), inputs.gaps == 2 ? -Q30_ONE / 16 : 0, Q30_ONE);
  in->demand = demand_of(double_q30(inputs.demand));
  in->gap = gap_of(double_q30(inputs.gap));
  in->reference = inputs.demand;
  in->position = inputs.gap;
  choose_applied(in);
}

static void fold(uint32_t word)
{
  uint32_t hash = (harness_box.hash ^ word) * 16777619U;
  harness_box.hash = hash ^ (hash >> 15);
}

static void measured(uint16_t section, uint32_t elapsed)
{
  volatile harness_section *s = &harness_box.sections[section];
  s->count++;
  if (elapsed < s->least) {
    s->least = elapsed;
  }
  if (elapsed > s->most) {
    s->most = elapsed;
    s->most_at = harness_box.step;
  }
  s->sum_low += elapsed;
  if (s->sum_low < elapsed) {
    s->sum_high++;
  }
}

/* The position controller, on signals of its own: what it answers does not reach the compensator,
   so that a difference in one of them does not spread to the other. Returns what was counted. */
static uint32_t control(const input *in, uint32_t *record)
{
  anhyst_pidd2_candidate_q31 candidate;
  harness_clock_start();
  const int32_t output = anhyst_pidd2_solve_q31(&gains, &controller, in->reference, in->position,
                                                in->load, &candidate);
  const uint32_t solve = harness_clock_stop();
  const int32_t applied = in->how == HARNESS_AS_SOLVED ? output : in->load;
  harness_clock_start();
  anhyst_pidd2_commit_q31(&gains, &controller, &candidate, applied);
  const uint32_t elapsed = solve + harness_clock_stop();
  measured(HARNESS_CONTROL_BLOCK, elapsed);
  record[HARNESS_PIDD2] = (uint32_t)output;
  record[HARNESS_INTEGRAL] = (uint32_t)controller.integral;
  record[HARNESS_VELOCITY] = (uint32_t)controller.velocity;
  return elapsed;
}

/* Solve and commit. Returns what the clock counted, its own share included. */
static uint32_t compensate(const input *in, uint32_t *record)
{
  harness_clock_start();
  const signal current = SOLVE(&compensator, in->demand, in->gap);
  const uint32_t solve = harness_clock_stop();
  record[HARNESS_CURRENT] = word_of(current);
  record[HARNESS_FLAGS] = compensator.flags;
  record[HARNESS_FLUX] = INNER_WORD(compensator.flux);

  const int as_solved = in->how == HARNESS_AS_SOLVED;
  const signal applied = as_solved ? current : in->applied;
  const signal applied_gap = as_solved ? in->gap : in->applied_gap;
  harness_clock_start();
  COMMIT(&compensator, applied, applied_gap);
  const uint32_t commit = harness_clock_stop();

  measured(HARNESS_SOLVE, solve);
  measured(as_solved ? HARNESS_COMMIT_SOLVED : HARNESS_COMMIT_OTHER, commit);
  record[HARNESS_DEMAND] = word_of(in->demand);
  record[HARNESS_GAP] = word_of(in->gap);
  record[HARNESS_HOW] = in->how;
  record[HARNESS_APPLIED] = word_of(applied);
  record[HARNESS_APPLIED_GAP] = word_of(applied_gap);
  return solve + commit;
}

static void run_step(const input *in)
{
  uint32_t record[HARNESS_RECORD_WORDS];
  const uint32_t step = harness_box.step;
  const uint32_t since = step - harness_box.checkpoint_first;
  const uint32_t place = step - harness_box.window_first;
  if (step >= harness_box.checkpoint_first && since % harness_box.checkpoint_stride == 0 &&
      since / harness_box.checkpoint_stride < HARNESS_CHECKPOINTS) {
    harness_box.checkpoints[since / harness_box.checkpoint_stride] = harness_box.hash;
  }
  const uint32_t elapsed = control(in, record) + compensate(in, record);
  measured(HARNESS_TICK, elapsed);
  record[HARNESS_OUTPUT] = word_of(OUTPUT(&compensator));
  record[HARNESS_FLUX_APPLIED] = INNER_WORD(compensator.flux_applied);
  record_memory(&compensator, record);
  for (uint32_t i = 0; i < HARNESS_RECORD_WORDS; i++) {
    fold(record[i]);
    if (step >= harness_box.window_first && place < HARNESS_WINDOW) {
      harness_box.window[place][i] = record[i];
    }
  }
  harness_box.step = step + 1;
}

static void start(void)
{
  for (uint32_t i = 0; i < HARNESS_SECTIONS; i++) {
    harness_box.sections[i].count = 0;
    harness_box.sections[i].least = 0xFFFFFFFFU;
    harness_box.sections[i].most = 0;
    harness_box.sections[i].most_at = 0;
    harness_box.sections[i].sum_low = 0;
    harness_box.sections[i].sum_high = 0;
  }
  harness_box.box_words = sizeof harness_box / sizeof(uint32_t);
  harness_box.state_bytes = sizeof compensator;
  harness_box.control_bytes = sizeof controller;
  anhyst_pidd2_start_q31(&gains, &controller, 0, 0, 0, 0);
  harness_box.words = PARAMETERS_WORDS;
  harness_box.stack_bytes = 0;
  harness_box.step = 0;
  harness_box.hash = 2166136261U;
  inputs.random = harness_box.seed;
  inputs.demand = 0;
  inputs.gap = Q30_ONE / 2;
  inputs.target = Q30_ONE;
  inputs.demands = 0;
  inputs.gaps = 0;
  harness_box.status = (uint32_t)(int32_t)take_parameters(&compensator);
  for (uint16_t i = 0; i < 4; i++) {
    harness_clock_start();
    measured(HARNESS_EMPTY, harness_clock_stop());
  }
}

/* The start-up sequence is part of what is compared: its length, and 64 of its currents. */
static void fold_conditioning(void)
{
  const int32_t length = CONDITIONING_LENGTH(&compensator);
  const int32_t stride = length / 63 + 1;
  fold((uint32_t)length);
  for (int32_t i = 0; i < 64; i++) {
    fold(word_of(CONDITIONING(&compensator, i * stride)));
  }
}

/* Bytes of stack that solve and commit of one step use, their return addresses included. */
static uint32_t stack_of(const input *in)
{
  const uintptr_t top = harness_stack_pointer();
  const uintptr_t end = harness_stack_end();
  uintptr_t low = top;
  if (end == 0) {
    return 0;
  }
  low = low - end > PAINTED_BYTES ? low - PAINTED_BYTES : end;
  /* Volatile, or the compiler calls memset, whose frame lies where it paints. */
  for (uintptr_t at = low; at < top; at++) {
    *(volatile unsigned char *)at = PAINT;
  }
  const signal current = SOLVE(&compensator, in->demand, in->gap);
  const int as_solved = in->how == HARNESS_AS_SOLVED;
  COMMIT(&compensator, as_solved ? current : in->applied, as_solved ? in->gap : in->applied_gap);
  uintptr_t deepest = low;
  while (deepest < top && *(volatile unsigned char *)deepest == PAINT) {
    deepest++;
  }
  return (uint32_t)(top - deepest);
}

/* None where the block was refused: nothing may run then. */
static uint32_t steps_to_run(void)
{
  return harness_box.status == ANHYST_OK ? harness_box.steps : 0;
}

static void measure_stack(void)
{
  input in;
  for (uint32_t i = 0; i < steps_to_run(); i++) {
    next_input(harness_box.step, &in);
    const uint32_t used = stack_of(&in);
    if (used > harness_box.stack_bytes) {
      harness_box.stack_bytes = used;
    }
    harness_box.step++;
  }
}

static void run_random(void)
{
  input in;
  for (uint32_t i = 0; i < steps_to_run(); i++) {
    next_input(harness_box.step, &in);
    run_step(&in);
  }
}

/* The window holds inputs on entry, inputs and outputs on return. */
static void run_vectors(void)
{
  input in;
  harness_box.window_first = harness_box.step;
  for (uint32_t i = 0; i < steps_to_run() && i < HARNESS_WINDOW; i++) {
    volatile uint32_t *row = harness_box.window[i];
    in.demand = signal_of(row[HARNESS_DEMAND]);
    in.gap = signal_of(row[HARNESS_GAP]);
    in.how = row[HARNESS_HOW];
    in.applied = signal_of(row[HARNESS_APPLIED]);
    in.applied_gap = signal_of(row[HARNESS_APPLIED_GAP]);
    in.reference = 0;
    in.position = 0;
    in.load = 0;
    run_step(&in);
  }
}

int harness_main(void)
{
  for (;;) {
    harness_wait();
    switch (harness_box.mode) {
    case HARNESS_START:
      start();
      if (harness_box.status == ANHYST_OK) {
        fold_conditioning();
      }
      break;
    case HARNESS_RANDOM:
      run_random();
      break;
    case HARNESS_VECTORS:
      run_vectors();
      break;
    case HARNESS_STACK:
      measure_stack();
      break;
    default:
      return 0;
    }
  }
}
