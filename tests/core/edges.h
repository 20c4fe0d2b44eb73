/* SPDX-License-Identifier: Apache-2.0 */
/* 32-bit numbers where fixed-point arithmetic goes wrong first: around zero, around every power
   of two, at both ends. */
#ifndef TEST_EDGES_H
#define TEST_EDGES_H

#include <stdint.h>

enum { EDGE_REACH = 2, EDGE_CENTRES = 65, EDGE_COUNT = EDGE_CENTRES * (2 * EDGE_REACH + 1) };

/* Number i of the edges, 0 <= i < EDGE_COUNT: 0, 2^k or -2^k, up to EDGE_REACH beside it. What
   would lie outside 32 bits wraps to the other end, which is an edge as well. */
static inline int32_t edge(int i)
{
  const int centre = i % EDGE_CENTRES;
  const int64_t power = centre == 0 ? 0 : (int64_t)1 << ((centre - 1) / 2);
  const int64_t value = (centre % 2 == 0 ? power : -power) + i / EDGE_CENTRES - EDGE_REACH;
  return (int32_t)(uint32_t)(uint64_t)value;
}

#endif
