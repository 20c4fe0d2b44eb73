/* SPDX-License-Identifier: Apache-2.0 */
/* Interface between the host, the test program of a target, and the port for its processor. The
 * host fills the mailbox, lets the target run until it calls harness_wait, and reads the mailbox.
 * All members are uint32_t, so that every target has the same layout. anhyst.verification.protocol
 * uses the same numbers and checks box_words. */
#ifndef HARNESS_H
#define HARNESS_H

#include <stdint.h>

#define HARNESS_CHECKPOINTS 64
#define HARNESS_WINDOW 48

/* Modes of a request. */
enum {
  HARNESS_START = 0,   /* initialise from the block, restart the generator with the seed */
  HARNESS_RANDOM = 1,  /* the next `steps` steps of the generator */
  HARNESS_VECTORS = 2, /* `steps` steps with the inputs in the window */
  HARNESS_STACK = 3    /* like HARNESS_RANDOM, but measures stack instead of time */
};

/* Source of the applied current of a step. */
enum {
  HARNESS_AS_SOLVED = 0, /* the applied current is the solved current at the same gap */
  HARNESS_AS_GIVEN = 1,  /* the applied current and its gap are in the record */
  HARNESS_ON_GRID = 2    /* the solved current is rounded to a converter of 12 bits */
};

/* One step of a compensator: inputs and outputs, in the order of their use. */
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

/* The build sets this macro for a stage, which has longer records. */
#ifndef HARNESS_RECORD_WORDS
#define HARNESS_RECORD_WORDS 18
#endif

/* One step of a position controller. */
enum {
  HARNESS_AT_POSITION,
  HARNESS_AT_TARGET,
  HARNESS_AT_LOAD,
  HARNESS_AT_CURRENT_1, /* measured current */
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
  HARNESS_AT_MEMORY_A, /* hysteresis state of magnet 1 */
  HARNESS_AT_MEMORY_B,
  HARNESS_AT_MEMORY_C,
  HARNESS_AT_END
};

/* Timed sections of a step. */
enum {
  HARNESS_EMPTY, /* the clock itself; it is subtracted from the other sections */
  HARNESS_SOLVE,
  HARNESS_COMMIT_SOLVED,
  HARNESS_COMMIT_ROUNDED, /* current rounded to the grid of a converter */
  HARNESS_COMMIT_LIMITED, /* solved current at a limit, whether rounded or not */
  HARNESS_COMMIT_OTHER,
  HARNESS_CONTROL_BLOCK,
  HARNESS_TICK_ROUNDED, /* whole step whose current was rounded and reached no limit */
  HARNESS_TICK,         /* whole step */
  HARNESS_SECTIONS
};

/* Sections of a position controller, in addition to HARNESS_TICK: by its action in the tick. */
enum {
  HARNESS_CONTROLS = HARNESS_SOLVE,      /* controls the position */
  HARNESS_RAMPS = HARNESS_COMMIT_SOLVED, /* ramps the force: lift-off or landing */
  HARNESS_RESTS = HARNESS_COMMIT_ROUNDED /* neither controls the position nor ramps the force */
};

typedef struct {
  uint32_t count, least, most, most_at, sum_low, sum_high;
} harness_section;

typedef struct {
  /* The host fills these members. */
  uint32_t mode;
  uint32_t seed;
  uint32_t steps;
  uint32_t first_checkpoint_step; /* first step before which the hash is stored */
  uint32_t checkpoint_stride;     /* number of steps between two stored hashes */
  uint32_t first_window_step;     /* first step whose record is stored */
  /* The target fills these members. */
  uint32_t box_words;
  uint32_t status;        /* result of the initialisation */
  uint32_t state_bytes;   /* size of the compensator or the controller */
  uint32_t control_bytes; /* sizeof(anhyst_pidd2_state_q31) */
  uint32_t words;         /* number of words of the parameter block */
  uint32_t stack_bytes;   /* largest stack of a call of solve or commit, return address included */
  uint32_t step;          /* steps since HARNESS_START */
  uint32_t hash;          /* hash of all records since HARNESS_START */
  harness_section sections[HARNESS_SECTIONS];
  uint32_t checkpoints[HARNESS_CHECKPOINTS];
  uint32_t window[HARNESS_WINDOW][HARNESS_RECORD_WORDS];
} harness_box_layout;

extern volatile harness_box_layout harness_box;

/* Functions of the port. */

/* Returns control to the host, which fills the mailbox before this function returns. */
void harness_wait(void);
/* Starts counting instructions or cycles. */
void harness_clock_start(void);
/* Returns the count since harness_clock_start, including the call of this function. */
uint32_t harness_clock_stop(void);
/* Return the stack pointer of the caller, and the lowest address of its stack; both are 0 if the
 * stack is not measured. */
uintptr_t harness_stack_pointer(void);
uintptr_t harness_stack_end(void);

/* Functions of the code under test: run_compensator.c, run_controller.c or run_stage.c. Each file
 * stores the inputs of one step. */

/* Resets all state; writes status, sizes and words into the mailbox. */
void subject_start(void);
/* Adds further data of the initialisation to the hash. */
void subject_fold_start(void);
/* Set the inputs of a step from the generator, or from a record. */
void subject_draw(uint32_t step);
void subject_read(const volatile uint32_t *row);
/* Runs a step, measures its parts, and fills the record. */
void subject_step(uint32_t *record);
/* Runs a step; returns the bytes of stack that it used. */
uint32_t subject_stack(void);

/* Functions of harness.c. */

/* Returns the next number of xorshift32: 1 .. 2^32 - 1. */
uint32_t harness_draw(void);
void harness_add_to_hash(uint32_t word);
void harness_measured(uint16_t section, uint32_t elapsed);
/* Returns only on the host. */
int harness_main(void);

#endif
