/* SPDX-License-Identifier: Apache-2.0 */
/* Runs a compensator and, in parallel, a PIDD2 controller (PID with second derivative), each with
   its own random signals. */
#include "anhyst/control/pidd2.h"
#include "signals.h"
#include "steps.h"

#define PHASE_STEPS 128U

/* State of the generator: q30 within -1..1, so that sums of two numbers cannot overflow. */
typedef struct {
  int32_t demand;
  int32_t gap;
  int32_t target;   /* target of the nested loops */
  uint32_t demands; /* kind of demand in this phase */
  uint32_t gaps;    /* kind of gap in this phase */
} generator;

typedef struct {
  signal demand, gap, applied, applied_gap;
  uint32_t how;
  int32_t reference, position, load; /* signals of the PIDD2, q31 */
} input;

static compensator_state compensator;
static generator inputs;
static input in;

/* Typical gains for a levitated mass at about 10 kHz. With inputs over the full range, each term
 * saturates occasionally. */
static const anhyst_pidd2_gains_q31 gains = {{20000, 1},  {24000, -6}, {-30000, 5}, {-17000, 6},
                                             {16384, -2}, {20000, -4}, {-28000, 0}, {-20000, 0},
                                             -8000,       0,           -2000000000, 2000000000};
static anhyst_pidd2_state_q31 controller;

/* Generates nested loops: moves to a target, and then to a target of opposite sign that is closer
 * to zero. */
static int32_t next_nested(int32_t demand)
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
    return next_nested(demand);
  case 4: /* reversals about a drifting level */
    return inputs.target / 2 + draw_q30(5);
  default: /* a ramp that reverses at random */
    if (harness_draw() % 64 == 0) {
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
    return draw_q30(0); /* half of the values are below the range */
  }
}

/* Selects the applied current: the solved one, the rounded one, or another current, sometimes at
 * another gap. */
static void choose_applied(void)
{
  const uint32_t kind = harness_draw() % 16;
  const uint32_t hows[3] = {HARNESS_AS_SOLVED, HARNESS_ON_GRID, HARNESS_AS_GIVEN};
  const int32_t applied = kind < 13 ? as_signed(harness_draw()) : double_q30(draw_q30(4));
  in.how = hows[(kind >= 5U) + (kind >= 11U)];
  in.applied = current_of(applied);
  in.applied_gap = kind == 15 ? gap_of(double_q30(clamp(draw_q30(0), 0, Q30_ONE))) : in.gap;
  in.load = applied / 8;
}

void subject_draw(uint32_t step)
{
  if (step % PHASE_STEPS == 0) {
    inputs.demands = harness_draw() % 6;
    inputs.gaps = harness_draw() % 4 < 3 ? harness_draw() % 2 : 2;
    inputs.target = draw_q30(0);
  }
  inputs.demand = clamp(next_demand(inputs.demand), -Q30_ONE, Q30_ONE);
  inputs.gap = clamp(next_gap(inputs.gap), inputs.gaps == 2 ? -Q30_ONE / 16 : 0, Q30_ONE);
  in.demand = demand_of(double_q30(inputs.demand));
  in.gap = gap_of(double_q30(inputs.gap));
  in.reference = inputs.demand;
  in.position = inputs.gap;
  choose_applied();
}

/* Runs the PIDD2 with its own signals. The output of the PIDD2 does not affect the compensator, so
 * that a difference in one does not spread to the other. Returns the counted cost. */
static uint32_t control(const input *at, uint32_t *record)
{
  anhyst_pidd2_candidate_q31 candidate;
  harness_clock_start();
  const int32_t output = anhyst_pidd2_solve_q31(&gains, &controller, at->reference, at->position,
                                                at->load, &candidate);
  const uint32_t solve = harness_clock_stop();
  const int32_t applied = at->how == HARNESS_AS_GIVEN ? at->load : output;
  harness_clock_start();
  anhyst_pidd2_commit_q31(&gains, &controller, &candidate, applied);
  const uint32_t elapsed = solve + harness_clock_stop();
  harness_measured(HARNESS_CONTROL_BLOCK, elapsed);
  record[HARNESS_PIDD2] = (uint32_t)output;
  record[HARNESS_INTEGRAL] = (uint32_t)controller.integral;
  record[HARNESS_VELOCITY] = (uint32_t)controller.velocity;
  return elapsed;
}

/* Returns the applied current for a solved current. */
static signal applied_of(const input *at, signal current)
{
  if (at->how == HARNESS_AS_GIVEN) {
    return at->applied;
  }
  return at->how == HARNESS_ON_GRID ? on_grid(current) : current;
}

static signal applied_gap_of(const input *at)
{
  return at->how == HARNESS_AS_GIVEN ? at->applied_gap : at->gap;
}

/* Returns the clock section of the commit. */
static uint16_t commit_section(const input *at, uint32_t flags)
{
  if (at->how == HARNESS_AS_GIVEN) {
    return HARNESS_COMMIT_OTHER;
  }
  if ((flags & ANHYST_CURRENT_LIMITED) != 0U) {
    return HARNESS_COMMIT_LIMITED;
  }
  return at->how == HARNESS_ON_GRID ? HARNESS_COMMIT_ROUNDED : HARNESS_COMMIT_SOLVED;
}

/* Runs solve and commit. Returns the counted cost, including that of the clock. */
static uint32_t compensate(const input *at, uint32_t *record, uint16_t *section)
{
  harness_clock_start();
  const signal current = SOLVE(&compensator, at->demand, at->gap);
  const uint32_t solve = harness_clock_stop();
  record[HARNESS_CURRENT] = word_of(current);
  record[HARNESS_FLAGS] = compensator.flags;
  record[HARNESS_FLUX] = FLUX_OF(&compensator);

  const signal applied = applied_of(at, current);
  const signal applied_gap = applied_gap_of(at);
  *section = commit_section(at, compensator.flags);
  harness_clock_start();
  COMMIT(&compensator, applied, applied_gap);
  const uint32_t commit = harness_clock_stop();

  harness_measured(HARNESS_SOLVE, solve);
  harness_measured(*section, commit);
  record[HARNESS_DEMAND] = word_of(at->demand);
  record[HARNESS_GAP] = word_of(at->gap);
  record[HARNESS_HOW] = at->how;
  record[HARNESS_APPLIED] = word_of(applied);
  record[HARNESS_APPLIED_GAP] = word_of(applied_gap);
  return solve + commit;
}

void subject_step(uint32_t *record)
{
  uint16_t section;
  const uint32_t elapsed = control(&in, record) + compensate(&in, record, &section);
  harness_measured(HARNESS_TICK, elapsed);
  if (section == HARNESS_COMMIT_ROUNDED) {
    harness_measured(HARNESS_TICK_ROUNDED, elapsed);
  }
  record[HARNESS_OUTPUT] = word_of(OUTPUT(&compensator));
  record[HARNESS_FLUX_APPLIED] = FLUX_APPLIED_OF(&compensator);
  record_memory(&compensator, record);
}

void subject_start(void)
{
  harness_box.state_bytes = sizeof compensator;
  harness_box.control_bytes = sizeof controller;
  harness_box.words = PARAMETERS_WORDS;
  anhyst_pidd2_start_q31(&gains, &controller, 0, 0, 0, 0);
  inputs.demand = 0;
  inputs.gap = Q30_ONE / 2;
  inputs.target = Q30_ONE;
  inputs.demands = 0;
  inputs.gaps = 0;
  harness_box.status = (uint32_t)(int32_t)take_parameters(&compensator);
}

/* Adds the start-up sequence to the hash: its length, and 64 of its currents. */
void subject_fold_start(void)
{
  const int32_t length = CONDITIONING_LENGTH(&compensator);
  const int32_t stride = length / 63 + 1;
  harness_add_to_hash((uint32_t)length);
  for (int32_t i = 0; i < 64; i++) {
    harness_add_to_hash(word_of(CONDITIONING(&compensator, i * stride)));
  }
}

void subject_read(const volatile uint32_t *row)
{
  in.demand = signal_of(row[HARNESS_DEMAND]);
  in.gap = signal_of(row[HARNESS_GAP]);
  in.how = row[HARNESS_HOW];
  in.applied = signal_of(row[HARNESS_APPLIED]);
  in.applied_gap = signal_of(row[HARNESS_APPLIED_GAP]);
  in.reference = 0;
  in.position = 0;
  in.load = 0;
}

/* Returns the bytes of stack that solve and commit of one step use, including their return
 * addresses. */
uint32_t subject_stack(void)
{
  const uintptr_t top = harness_stack_pointer();
  const uintptr_t low = painted_from(top);
  paint(low, top);
  const signal current = SOLVE(&compensator, in.demand, in.gap);
  COMMIT(&compensator, applied_of(&in, current), applied_gap_of(&in));
  return (uint32_t)(top - deepest(low, top));
}
