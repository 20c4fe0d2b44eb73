/* SPDX-License-Identifier: Apache-2.0 */
/* Defines one set of names for the compensator in every signal format.
 *
 * HARNESS_IO is 15, 31 or 32: q15, q31 or f32. A word contains the 32 bits of a fixed-point or
 * floating-point number. */
#ifndef SIGNALS_H
#define SIGNALS_H

#include "anhyst/actuator.h"
#include "harness.h"

#if HARNESS_IO == 32

typedef float signal;
typedef anhyst_compensator_f32 compensator_state;
#define SOLVE anhyst_compensator_solve_f32
#define COMMIT anhyst_compensator_commit_f32
#define OUTPUT anhyst_compensator_output_f32
#define CONDITIONING anhyst_conditioning_f32
#define CONDITIONING_LENGTH anhyst_conditioning_length_f32
#define INIT anhyst_compensator_init_f32

static inline uint32_t word_of(signal a)
{
  union {
    signal number;
    uint32_t word;
  } as;
  as.number = a;
  return as.word;
}

static inline signal signal_of(uint32_t word)
{
  union {
    signal number;
    uint32_t word;
  } as;
  as.word = word;
  return as.number;
}

/* Returns a q31 fraction of a range, times 1.1 so that limits are exceeded too. */
static inline signal part_of(int32_t a, signal range)
{
  return (signal)a * (1.1F / 2147483648.0F) * range;
}

/* Returns the upper limit of a signal in its unit. */
static inline signal high_of(int limit, int scale)
{
  return ACTUATOR_PARAMETERS[limit] * ACTUATOR_PARAMETERS[scale];
}

static inline signal demand_of(int32_t a)
{
  return part_of(a, high_of(ANHYST_WORD_DEMAND_HIGH, ANHYST_WORD_SCALE_DEMAND));
}

static inline signal current_of(int32_t a)
{
  return part_of(a, high_of(ANHYST_WORD_CURRENT_HIGH, ANHYST_WORD_SCALE_CURRENT));
}

static inline signal gap_of(int32_t a)
{
  const signal low = ACTUATOR_PARAMETERS[ANHYST_WORD_SCALE_GAP_LOW];
  return low + part_of(a, ACTUATOR_PARAMETERS[ANHYST_WORD_SCALE_GAP_HIGH] - low);
}

/* Returns the nearest current of a 12-bit converter between minus and plus the largest current. */
static inline signal on_grid(signal current)
{
  const signal step = high_of(ANHYST_WORD_CURRENT_HIGH, ANHYST_WORD_SCALE_CURRENT) / 2048.0F;
  const int32_t code = (int32_t)(current / step + (current < 0.0F ? -0.5F : 0.5F));
  return (signal)code * step;
}

#define INNER_WORD word_of

static inline void record_memory(const compensator_state *c, uint32_t *record)
{
  union {
    anhyst_memory_f32 memory;
    uint32_t word[5];
  } as;
  as.memory = c->memory;
  for (int i = 0; i < 5; i++) {
    record[HARNESS_MEMORY_A + i] = as.word[i];
  }
}

#else

#if HARNESS_IO == 15
typedef int16_t signal;
#define SIGNAL_SHIFT 16
#define SOLVE anhyst_compensator_solve_q15
#define COMMIT anhyst_compensator_commit_q15
#define OUTPUT anhyst_compensator_output_q15
#define CONDITIONING anhyst_conditioning_q15
#else
typedef int32_t signal;
#define SIGNAL_SHIFT 0
#ifndef HARNESS_PLAY
#define SOLVE anhyst_compensator_solve_q31
#define COMMIT anhyst_compensator_commit_q31
#define OUTPUT anhyst_compensator_output_q31
#define CONDITIONING anhyst_conditioning_q31
#endif
#endif

static inline uint32_t word_of(signal a) { return (uint32_t)(int32_t)a; }

/* Returns the number whose two's complement is the word, independent of the compiler. */
static inline signal signal_of(uint32_t word)
{
  return (signal)(word <= 0x7FFFFFFFU ? (int32_t)word : -(int32_t)(0xFFFFFFFFU - word) - 1);
}

static inline signal demand_of(int32_t a) { return (signal)(a >> SIGNAL_SHIFT); }

#define current_of demand_of
#define gap_of demand_of

/* Returns the nearest current of a 12-bit converter; the highest code is 2047. */
static inline signal on_grid(signal current)
{
  const int32_t code = (current / ((int32_t)1 << (19 - SIGNAL_SHIFT)) + (current < 0 ? -1 : 1)) / 2;
  return (signal)((code < 2048 ? code : 2047) * ((int32_t)1 << (20 - SIGNAL_SHIFT)));
}

static inline uint32_t inner_word(int32_t a) { return (uint32_t)a; }

#define INNER_WORD inner_word

#ifdef HARNESS_PLAY
#include "play.h"
#else

typedef anhyst_compensator compensator_state;
#define CONDITIONING_LENGTH anhyst_conditioning_length
#define INIT anhyst_compensator_init

static inline void record_memory(const compensator_state *c, uint32_t *record)
{
  record[HARNESS_MEMORY_A] = (uint32_t)c->memory.number[0];
  record[HARNESS_MEMORY_B] = (uint32_t)c->memory.number[1];
  record[HARNESS_MEMORY_C] = (uint32_t)c->memory.number[2];
  record[HARNESS_MEMORY_D] = 0;
  record[HARNESS_MEMORY_E] = 0;
}

#endif
#endif

#ifndef HARNESS_PLAY
#define PARAMETERS_WORDS ACTUATOR_PARAMETERS_WORDS
#define FLUX_OF(c) INNER_WORD((c)->flux)
#define FLUX_APPLIED_OF(c) INNER_WORD((c)->flux_applied)

static inline anhyst_status take_parameters(compensator_state *c)
{
  return INIT(c, &ACTUATOR_KERNEL, ACTUATOR_PARAMETERS, ACTUATOR_PARAMETERS_WORDS);
}
#endif
#endif
