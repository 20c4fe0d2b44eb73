/* SPDX-License-Identifier: Apache-2.0 */
/* 32-bit numbers at which fixed-point errors are likely: around zero, around every power of two,
   and at both ends. */
#ifndef TEST_EDGES_H
#define TEST_EDGES_H

#include <stdint.h>

enum { EDGE_REACH = 2, EDGE_CENTRES = 65, EDGE_COUNT = EDGE_CENTRES * (2 * EDGE_REACH + 1) };

/* Returns edge i, 0 <= i < EDGE_COUNT: 0, 2^k or -2^k, plus or minus up to EDGE_REACH. Numbers
   outside 32 bits wrap to the other end, which is also an edge. */
static inline int32_t edge_number(int i)
{
  const int centre = i % EDGE_CENTRES;
  const int64_t power = centre == 0 ? 0 : (int64_t)1 << ((centre - 1) / 2);
  const int64_t value = (centre % 2 == 0 ? power : -power) + i / EDGE_CENTRES - EDGE_REACH;
  return (int32_t)(uint32_t)(uint64_t)value;
}

#endif
