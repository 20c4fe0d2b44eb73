/* SPDX-License-Identifier: Apache-2.0 */
/* Functions that a C compiler calls implicitly, for targets without a library. */
#ifndef FREESTANDING_H
#define FREESTANDING_H

#include <stdint.h>

void *memset(void *to, int value, __SIZE_TYPE__ n);
void *memcpy(void *restrict to, const void *restrict from, __SIZE_TYPE__ n);

/* Divides a by b and stores the remainder in *rest, one bit of the quotient at a time; b must not
 * be 0. */
uint32_t freestanding_divide(uint32_t a, uint32_t b, uint32_t *rest);

/* Divides signed numbers in the same way, rounded towards zero; the remainder has the sign of a. */
int32_t freestanding_divide_signed(int32_t a, int32_t b, int32_t *rest);

#endif
