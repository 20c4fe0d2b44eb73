/* SPDX-License-Identifier: Apache-2.0 */
#include "freestanding.h"

/* Volatile, because otherwise the compiler recognises the loops and replaces each loop by a call of
 * the same function. */
void *memset(void *to, int value, __SIZE_TYPE__ n)
{
  volatile unsigned char *at = to;
  while (n-- > 0) {
    *at++ = (unsigned char)value;
  }
  return to;
}

void *memcpy(void *restrict to, const void *restrict from, __SIZE_TYPE__ n)
{
  volatile unsigned char *at = to;
  const unsigned char *source = from;
  while (n-- > 0) {
    *at++ = *source++;
  }
  return to;
}

uint32_t freestanding_divide(uint32_t a, uint32_t b, uint32_t *rest)
{
  uint32_t quotient = 0;
  uint32_t bit = 1;
  while (b <= a >> 1) {
    b <<= 1;
    bit <<= 1;
  }
  for (; bit > 0; bit >>= 1) {
    if (a >= b) {
      a -= b;
      quotient |= bit;
    }
    b >>= 1;
  }
  *rest = a;
  return quotient;
}

static uint32_t magnitude(int32_t a) { return a < 0 ? 0U - (uint32_t)a : (uint32_t)a; }

int32_t freestanding_divide_signed(int32_t a, int32_t b, int32_t *rest)
{
  uint32_t left;
  const uint32_t quotient = freestanding_divide(magnitude(a), magnitude(b), &left);
  *rest = (int32_t)(a < 0 ? 0U - left : left);
  return (int32_t)((a < 0) != (b < 0) ? 0U - quotient : quotient);
}
