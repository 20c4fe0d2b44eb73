/* SPDX-License-Identifier: Apache-2.0 */
#ifndef ANHYST_PLAYS_H
#define ANHYST_PLAYS_H

#include <limits.h>

/* Plays of the law of cells that have a width, at most. */
#define ANHYST_CELLS 12

/* What a compensator has room for: memories of its law. 1 for thin iron, in which the field is the
   same throughout; solid iron needs one for each layer, and one more where a part of it is
   laminated. Given to the compiler, the same for all files of a program. */
#ifndef ANHYST_MEMORIES
#define ANHYST_MEMORIES 1
#endif

/* What a saved memory begins with. */
#define ANHYST_SAVED_VERSION 1U

/* Size of a type in words of 16 bits. */
#define ANHYST_WORDS_OF(type) (sizeof(type) * CHAR_BIT / 16U)

/* Missed ticks that a commit makes up for at most. */
#define ANHYST_CATCH_UP_TICKS_MAX 64U

#endif
