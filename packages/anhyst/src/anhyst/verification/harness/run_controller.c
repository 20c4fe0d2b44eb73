/* SPDX-License-Identifier: Apache-2.0 */
/* Runs a whole position controller in the harness, tick by tick. */
#include "anhyst/actuator.h"
#include "steps.h"

#include ACTUATOR_FILE(ACTUATOR_JOIN(ACTUATOR_NAME, _controller).h)

#define CONTROLLER(part) ACTUATOR_JOIN(ACTUATOR_NAME, _controller##part)
#define MAGNETS ACTUATOR_JOIN(ACTUATOR_MACRO, _CONTROLLER_MAGNETS)

#define PHASE_STEPS 128U

typedef char same_size[(int)HARNESS_AT_END == (int)HARNESS_RECORD_WORDS ? 1 : -1];

/* State of the generator. */
typedef struct {
  int32_t position;
  uint32_t motion; /* motion of the position in this phase */
} generator;

static CONTROLLER() controller;
static generator inputs;
static CONTROLLER(_sample) in;

void subject_start(void)
{
  harness_box.state_bytes = sizeof controller;
  harness_box.control_bytes = sizeof controller.position.state;
  harness_box.words = ACTUATOR_PARAMETERS_WORDS;
  inputs.position = 0;
  inputs.motion = 0;
  harness_box.status = (uint32_t)(int32_t)CONTROLLER(_init)(&controller);
}

/* Adds those limits to the hash that have the same size on all targets. */
void subject_fold_start(void)
{
  const anhyst_position_limits_q31 *limits = &CONTROLLER(_limits);
  harness_add_to_hash((uint32_t)limits->levitation.low);
  harness_add_to_hash((uint32_t)limits->levitation.high);
  harness_add_to_hash((uint32_t)limits->current_low);
  harness_add_to_hash((uint32_t)limits->current_high);
  harness_add_to_hash((uint32_t)limits->current_step);
}

static int32_t next_position(int32_t position)
{
  const anhyst_levitation_limits *limits = &CONTROLLER(_limits).levitation;
  const int32_t part = draw_q30(inputs.motion % 4U == 0U ? 9 : 3) / 65536;
  const int32_t step = limits->step / 16384 * part;
  return clamp(position / 2 + step / 2, limits->low / 2, limits->high / 2) * 2;
}

/* Returns commands for a lift-off frequently, and all other commands occasionally. */
static uint16_t next_command(void)
{
  const uint32_t kind = harness_draw() % 1024U;
  if (kind < 96U) {
    return kind < 32U   ? (uint16_t)ANHYST_COMMAND_LIFT
           : kind < 64U ? (uint16_t)ANHYST_COMMAND_DEMAGNETISED
                        : (uint16_t)ANHYST_COMMAND_CLEAR;
  }
  return kind < 104U ? (uint16_t)(kind - 96U) : (uint16_t)ANHYST_COMMAND_NONE;
}

void subject_draw(uint32_t step)
{
  if (step % PHASE_STEPS == 0) {
    inputs.motion = harness_draw() % 32U;
    in.target = double_q30(draw_q30(0));
  }
  inputs.position = next_position(inputs.position);
  in.position = inputs.motion == 31U ? double_q30(draw_q30(0)) : inputs.position;
  in.dropped = inputs.motion == 30U || harness_draw() % 64U == 0U ? 1U : 0U;
  in.command = next_command();
  in.load = double_q30(draw_q30(4));
  for (uint16_t i = 0; i < MAGNETS; i++) {
    in.current[i] = double_q30(draw_q30(0));
  }
}

void subject_read(const volatile uint32_t *row)
{
  in.position = as_signed(row[HARNESS_AT_POSITION]);
  in.target = as_signed(row[HARNESS_AT_TARGET]);
  in.load = as_signed(row[HARNESS_AT_LOAD]);
  for (uint16_t i = 0; i < MAGNETS; i++) {
    in.current[i] = as_signed(row[HARNESS_AT_CURRENT_1 + i]);
  }
  in.dropped = (uint16_t)(row[HARNESS_AT_EVENT] >> 16);
  in.command = (uint16_t)(row[HARNESS_AT_EVENT] & 0xFFFFU);
}

/* Returns the clock section for the action of the controller in this tick. */
static uint16_t section(void)
{
  const uint16_t phase = controller.position.levitation.phase;
  if (anhyst_levitation_controls(&controller.position.levitation)) {
    return HARNESS_CONTROLS;
  }
  return phase == ANHYST_PHASE_BREAKAWAY || phase == ANHYST_PHASE_SET_DOWN ? HARNESS_RAMPS
                                                                           : HARNESS_RESTS;
}

static void record_inputs(uint32_t *record)
{
  record[HARNESS_AT_POSITION] = (uint32_t)in.position;
  record[HARNESS_AT_TARGET] = (uint32_t)in.target;
  record[HARNESS_AT_LOAD] = (uint32_t)in.load;
  record[HARNESS_AT_CURRENT_2] = 0;
  for (uint16_t i = 0; i < MAGNETS; i++) {
    record[HARNESS_AT_CURRENT_1 + i] = (uint32_t)in.current[i];
  }
  record[HARNESS_AT_EVENT] = (uint32_t)in.dropped << 16 | in.command;
}

void subject_step(uint32_t *record)
{
  CONTROLLER(_answer) answer;
  harness_clock_start();
  CONTROLLER(_tick)(&controller, &in, &answer);
  const uint32_t elapsed = harness_clock_stop();
  harness_measured(section(), elapsed);
  harness_measured(HARNESS_TICK, elapsed);
  record_inputs(record);
  record[HARNESS_AT_DRIVE_2] = 0;
  for (uint16_t i = 0; i < MAGNETS; i++) {
    record[HARNESS_AT_DRIVE_1 + i] = (uint32_t)answer.current[i];
  }
  record[HARNESS_AT_REFERENCE] = (uint32_t)answer.reference;
  record[HARNESS_AT_DEMAND] = (uint32_t)answer.demand;
  record[HARNESS_AT_STATE] = answer.state;
  record[HARNESS_AT_FLAGS] = answer.flags;
  record[HARNESS_AT_FAULT] = controller.position.levitation.supervisor.fault;
  record[HARNESS_AT_INTEGRAL] = (uint32_t)controller.position.state.integral;
  record[HARNESS_AT_VELOCITY] = (uint32_t)controller.position.state.velocity;
  record[HARNESS_AT_MEMORY_A] = (uint32_t)controller.magnet[0].compensator.memory.number[0];
  record[HARNESS_AT_MEMORY_B] = (uint32_t)controller.magnet[0].compensator.memory.number[1];
  record[HARNESS_AT_MEMORY_C] = (uint32_t)controller.magnet[0].compensator.memory.number[2];
}

/* Returns the bytes of stack that a tick uses, including its return address. */
uint32_t subject_stack(void)
{
  CONTROLLER(_answer) answer;
  const uintptr_t top = harness_stack_pointer();
  const uintptr_t low = painted_from(top);
  paint(low, top);
  CONTROLLER(_tick)(&controller, &in, &answer);
  return (uint32_t)(top - deepest(low, top));
}
