/* SPDX-License-Identifier: Apache-2.0 */
#ifndef ANHYST_PLAYS_H
#define ANHYST_PLAYS_H

#include <limits.h>

/* Maximum number of play cells with a threshold above 0. */
#define ANHYST_CELLS 12

/* Number of hysteresis states in a compensator; a compiler option, the same for all files of a
   program. Laminated iron, whose field is uniform, needs 1. Solid iron needs one state for each
   layer, and one more if a part of its flux path is laminated. */
#ifndef ANHYST_MEMORIES
#define ANHYST_MEMORIES 1
#endif

/* Version at the start of a saved state. */
#define ANHYST_SAVED_VERSION 2U

/* Size of a type in words of 16 bits. */
#define ANHYST_WORDS_OF(type) (sizeof(type) * CHAR_BIT / 16U)

/* Maximum number of missed ticks that anhyst_compensator_commit_after commits. */
#define ANHYST_CATCH_UP_TICKS_MAX 64U

#endif
