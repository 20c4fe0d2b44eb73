/* SPDX-License-Identifier: Apache-2.0 */
#ifndef ANHYST_PLAYS_H
#define ANHYST_PLAYS_H

/* Plays of the law of cells that have a width, at most. */
#define ANHYST_CELLS 12

/* What a compensator has room for: memories of its law. 1 for thin iron, in which the field is the
   same throughout; solid iron needs one for each layer, and one more where a part of it is
   laminated. Given to the compiler, the same for all files of a program. */
#ifndef ANHYST_MEMORIES
#define ANHYST_MEMORIES 1
#endif

#endif
