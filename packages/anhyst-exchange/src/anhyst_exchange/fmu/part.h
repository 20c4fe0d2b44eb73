/* SPDX-License-Identifier: Apache-2.0 */
/* What distinguishes one kind of component from another. One is linked; the numbers of this one
   example of it are in the header beside it, which is generated. */
#ifndef ANHYST_PART_H
#define ANHYST_PART_H

#include <stddef.h>

typedef struct {
  size_t tables;              /* bytes that are built once an instance and then only read */
  size_t state;               /* bytes that change; pointers in them are set anew at every tick */
  int (*build)(void *tables); /* from zeros; 0, or -1 without memory; null: nothing to build */
  void (*drop)(void *tables); /* gives back what build took; null with it */
  /* Sets the pointers in a state that comes from another instance. */
  void (*relink)(const void *tables, void *state);
  /* The state at time 0, from zeros, and the outputs there. 0, or -1 for damaged parameters. */
  int (*start)(const void *tables, void *state, double *values);
  /* One tick of so many seconds: from inputs to outputs. Null, or why there is no answer; then
     nothing has changed. */
  const char *(*tick)(const void *tables, void *state, double *values, double seconds);
} anhyst_part;

extern const anhyst_part anhyst_the_part;

#endif
