/* SPDX-License-Identifier: Apache-2.0 */
/* What a C compiler calls without being asked, for targets without a library. */
#ifndef FREESTANDING_H
#define FREESTANDING_H

#include <stdint.h>

void *memset(void *to, int value, __SIZE_TYPE__ n);
void *memcpy(void *restrict to, const void *restrict from, __SIZE_TYPE__ n);

/* Schoolbook division, one bit of the quotient at a time; b is not 0. */
uint32_t freestanding_divide(uint32_t a, uint32_t b, uint32_t *rest);

/* The same for two's complement, towards zero; the rest has the sign of a. */
int32_t freestanding_divide_signed(int32_t a, int32_t b, int32_t *rest);

#endif
