/* SPDX-License-Identifier: Apache-2.0 */
/* What a target runs to be compared with the host, and what its port has to supply.

   The host fills the box, lets the target run until it calls harness_wait, and reads the box. All
   of it is uint32_t, so that every target lays it out alike; anhyst.verification.protocol holds the
   same numbers and checks HARNESS_BOX_WORDS. */
#ifndef HARNESS_H
#define HARNESS_H

#include <stdint.h>

#define HARNESS_CHECKPOINTS 64
#define HARNESS_WINDOW 48

/* What to do. */
enum {
  HARNESS_START = 0,   /* take the block, forget everything, restart the generator with the seed */
  HARNESS_RANDOM = 1,  /* the next `steps` steps of the generator */
  HARNESS_VECTORS = 2, /* `steps` steps with the inputs that stand in the window */
  HARNESS_STACK = 3    /* as HARNESS_RANDOM, measuring stack instead of time */
};

/* How the current of a step comes about. */
enum {
  HARNESS_AS_SOLVED = 0, /* applied is the solved current at the same gap */
  HARNESS_AS_GIVEN = 1,  /* applied and its gap stand in the record */
  HARNESS_ON_GRID = 2    /* as solved, rounded to a converter of 12 bits */
};

/* One step of a compensator: what goes in and what comes out, in the order in which it does. */
enum {
  HARNESS_DEMAND,
  HARNESS_GAP,
  HARNESS_HOW,
  HARNESS_CURRENT,
  HARNESS_FLAGS,
  HARNESS_FLUX,
  HARNESS_APPLIED,
  HARNESS_APPLIED_GAP,
  HARNESS_OUTPUT,
  HARNESS_FLUX_APPLIED,
  HARNESS_MEMORY_A,
  HARNESS_MEMORY_B,
  HARNESS_MEMORY_C,
  HARNESS_MEMORY_D,
  HARNESS_MEMORY_E,
  HARNESS_PIDD2,
  HARNESS_INTEGRAL,
  HARNESS_VELOCITY
};

/* Of a stage, whose records are longer, the build says how many. */
#ifndef HARNESS_RECORD_WORDS
#define HARNESS_RECORD_WORDS 18
#endif

/* One step of a position controller. */
enum {
  HARNESS_AT_POSITION,
  HARNESS_AT_TARGET,
  HARNESS_AT_LOAD,
  HARNESS_AT_CURRENT_1, /* measured */
  HARNESS_AT_CURRENT_2,
  HARNESS_AT_EVENT, /* 65536*dropped + command */
  HARNESS_AT_DRIVE_1,
  HARNESS_AT_DRIVE_2,
  HARNESS_AT_REFERENCE,
  HARNESS_AT_DEMAND,
  HARNESS_AT_STATE,
  HARNESS_AT_FLAGS,
  HARNESS_AT_FAULT,
  HARNESS_AT_INTEGRAL,
  HARNESS_AT_VELOCITY,
  HARNESS_AT_MEMORY_A, /* of the iron of magnet 1 */
  HARNESS_AT_MEMORY_B,
  HARNESS_AT_MEMORY_C,
  HARNESS_AT_END
};

/* What is timed. */
enum {
  HARNESS_EMPTY, /* the clock itself: to be taken off the others */
  HARNESS_SOLVE,
  HARNESS_COMMIT_SOLVED,
  HARNESS_COMMIT_ROUNDED, /* to a converter's grid */
  HARNESS_COMMIT_LIMITED, /* of a solved current that met a limit, rounded or not */
  HARNESS_COMMIT_OTHER,
  HARNESS_CONTROL_BLOCK,
  HARNESS_TICK_ROUNDED, /* all of a step whose current was solved without a limit, and rounded */
  HARNESS_TICK,         /* all of one step */
  HARNESS_SECTIONS
};

/* And of a position controller, beside the tick: by what it does at it. */
enum {
  HARNESS_CONTROLS = HARNESS_SOLVE,      /* controls the position */
  HARNESS_RAMPS = HARNESS_COMMIT_SOLVED, /* demands a force of its own: lift-off, setting down */
  HARNESS_RESTS = HARNESS_COMMIT_ROUNDED /* neither */
};

typedef struct {
  uint32_t count, least, most, most_at, sum_low, sum_high;
} harness_section;

typedef struct {
  /* Filled by the host. */
  uint32_t mode;
  uint32_t seed;
  uint32_t steps;
  uint32_t checkpoint_first;  /* hash is kept before this step, and every ... */
  uint32_t checkpoint_stride; /* ... so many steps after it */
  uint32_t window_first;      /* records are kept from this step on */
  /* Filled by the target. */
  uint32_t box_words;
  uint32_t status;        /* of the subject's start */
  uint32_t state_bytes;   /* of the compensator or the controller */
  uint32_t control_bytes; /* sizeof(anhyst_pidd2_state_q31) */
  uint32_t words;         /* of the parameter block */
  uint32_t
      stack_bytes; /* deepest so far below a call of solve or commit, return address included */
  uint32_t step;   /* steps since HARNESS_START */
  uint32_t hash;   /* of everything since HARNESS_START */
  harness_section sections[HARNESS_SECTIONS];
  uint32_t checkpoints[HARNESS_CHECKPOINTS];
  uint32_t window[HARNESS_WINDOW][HARNESS_RECORD_WORDS];
} harness_box_layout;

extern volatile harness_box_layout harness_box;

/* Supplied by the port. */

/* Gives way to the host, which fills the box again before this returns. */
void harness_wait(void);
/* Starts counting instructions or cycles. */
void harness_clock_start(void);
/* Counted since harness_clock_start, the call of this function included. */
uint32_t harness_clock_stop(void);
/* The stack pointer of the caller, and the lowest address its stack may reach; both 0 where the
   stack is not measured. */
uintptr_t harness_stack_pointer(void);
uintptr_t harness_stack_end(void);

/* Supplied by the subject, run_compensator.c, run_controller.c or run_stage.c. Each keeps the
   inputs of one step. */

/* Forgets everything; puts status, sizes and words in the box. */
void subject_start(void);
/* Folds what else of a start is compared. */
void subject_fold_start(void);
/* Takes the inputs of a step from the generator, or from a record. */
void subject_draw(uint32_t step);
void subject_read(const volatile uint32_t *row);
/* Runs a step, measures its parts, and fills the record. */
void subject_step(uint32_t *record);
/* Runs a step; the bytes of stack that it took. */
uint32_t subject_stack(void);

/* Supplied by harness.c. */

/* xorshift32: 1 .. 2^32 - 1. */
uint32_t harness_draw(void);
void harness_fold(uint32_t word);
void harness_measured(uint16_t section, uint32_t elapsed);
/* Never returns but on the host. */
int harness_main(void);

#endif
