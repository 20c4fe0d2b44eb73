/* SPDX-License-Identifier: Apache-2.0 */
/* Functions and sizes that define one kind of component. A component links one such set. The
 * parameters of the actual component are in a generated header. */
#ifndef ANHYST_PART_H
#define ANHYST_PART_H

#include <stddef.h>

typedef struct {
  size_t tables; /* bytes that are built once per instance and then only read */
  size_t state;  /* bytes of the state; its pointers are set again at every tick */
  /* Builds the tables from zeros. Returns 0, or -1 without memory. Null: nothing to build. */
  int (*build)(void *tables);
  void (*drop)(void *tables); /* frees the memory that build allocated; null if build is null */
  /* Sets the pointers in a state that was copied from another instance. */
  void (*relink)(const void *tables, void *state);
  /* Sets the state and its outputs at time 0; the state is zero before the call. Returns 0, or -1
   * if parameters are damaged. */
  int (*start)(const void *tables, void *state, double *values);
  /* Computes one tick of the given duration (s), from inputs to outputs. Returns null, or the
   * reason why there is no result; then nothing has changed. */
  const char *(*tick)(const void *tables, void *state, double *values, double seconds);
} anhyst_part;

extern const anhyst_part anhyst_the_part;

#endif
