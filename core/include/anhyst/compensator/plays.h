/* SPDX-License-Identifier: Apache-2.0 */
#ifndef ANHYST_PLAYS_H
#define ANHYST_PLAYS_H

/* Plays of the law of cells that have a width, at most. */
#define ANHYST_CELLS 12

#endif
