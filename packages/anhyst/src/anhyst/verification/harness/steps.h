/* SPDX-License-Identifier: Apache-2.0 */
/* Functions for all code under test: random numbers, and painted stack. */
#ifndef STEPS_H
#define STEPS_H

#include "harness.h"

#define Q30_ONE ((int32_t)1073741824)
#define PAINT 0xA5U
#ifndef PAINTED_BYTES
#define PAINTED_BYTES 1024U
#endif

/* Returns the number whose two's complement is the word u, independent of the compiler. */
static inline int32_t as_signed(uint32_t u)
{
  return u <= 0x7FFFFFFFU ? (int32_t)u : -(int32_t)(0xFFFFFFFFU - u) - 1;
}

/* Returns a uniform random q30 number in -1..1, shifted right by n. */
static inline int32_t draw_q30(uint16_t n)
{
  const int32_t r = (int32_t)(harness_draw() >> 1) - Q30_ONE;
  return r / (int32_t)((uint32_t)1 << n);
}

static inline int32_t clamp(int32_t a, int32_t low, int32_t high)
{
  if (a < low) {
    return low;
  }
  return a > high ? high : a;
}

/* Converts a q30 number within -1..1 to q31; 1.0 becomes the largest number. */
static inline int32_t double_q30(int32_t a) { return a >= Q30_ONE ? INT32_MAX : a * 2; }

/* Returns the lowest address to paint below a stack pointer, or the stack pointer itself if the
 * stack is not measured. The functions for painting are inlined into the caller of the measured
 * function, because their frames would be in the painted area. */
static inline __attribute__((always_inline)) uintptr_t painted_from(uintptr_t top)
{
  const uintptr_t end = harness_stack_end();
  if (end == 0) {
    return top;
  }
  return top - end > PAINTED_BYTES ? top - PAINTED_BYTES : end;
}

/* Volatile, because otherwise the compiler calls memset, whose frame is in the painted area. */
static inline __attribute__((always_inline)) void paint(uintptr_t low, uintptr_t top)
{
  for (uintptr_t at = low; at < top; at++) {
    *(volatile unsigned char *)at = PAINT;
  }
}

static inline __attribute__((always_inline)) uintptr_t deepest(uintptr_t low, uintptr_t top)
{
  uintptr_t at = low;
  while (at < top && *(volatile unsigned char *)at == PAINT) {
    at++;
  }
  return at;
}

#endif
