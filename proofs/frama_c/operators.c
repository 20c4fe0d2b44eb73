/* SPDX-License-Identifier: Apache-2.0 */
/* The operators of fixed.h with an int of 16 bits: no expression overflows, and the contracts state
   the results as exact integers. proofs/esbmc/contracts.h uses the contract of anhyst_scale. */
#include <stdint.h>

/*@ assigns \nothing;
    ensures \result == (a > 32767 ? 32767 : a < -32768 ? -32768 : a); */
static inline int16_t anhyst_sat_q15(int32_t a);

/*@ assigns \nothing;
    ensures \result == (a + b > 32767 ? 32767 : a + b < -32768 ? -32768 : a + b); */
static inline int16_t anhyst_add_q15(int16_t a, int16_t b);

/*@ assigns \nothing;
    ensures \result == (a - b > 32767 ? 32767 : a - b < -32768 ? -32768 : a - b); */
static inline int16_t anhyst_sub_q15(int16_t a, int16_t b);

/*@ assigns \nothing; */
static inline int16_t anhyst_mul_q15(int16_t a, int16_t b);

/*@ assigns \nothing;
    ensures \result == (a + b > 2147483647 ? 2147483647 : a + b < -2147483648 ? -2147483648 :
                        a + b); */
static inline int32_t anhyst_add_q31(int32_t a, int32_t b);

/*@ assigns \nothing;
    ensures \result == (a - b > 2147483647 ? 2147483647 : a - b < -2147483648 ? -2147483648 :
                        a - b); */
static inline int32_t anhyst_sub_q31(int32_t a, int32_t b);

/*@ assigns \nothing;
    ensures \result == (a >= 0 ? a : a == -2147483648 ? 2147483647 : -a); */
static inline int32_t anhyst_abs_q31(int32_t a);

/*@ requires low <= high;
    assigns \nothing;
    ensures \result == (a < low ? low : a > high ? high : a); */
static inline int32_t anhyst_clamp(int32_t a, int32_t low, int32_t high);

/*@ assigns \nothing;
    ensures 65536 * \result <= a * b < 65536 * \result + 65536;
    ensures b == 0 ==> \result == 0;
    ensures b > 0 && a >= 0 ==> 0 <= \result && 2 * \result <= a;
    ensures b > 0 && a < 0 ==> \result < 0;
    ensures b > 0 && a < 0 ==> 2 * \result >= a - 1;
    ensures b < 0 && a >= 0 ==> \result <= 0 && 2 * \result >= -a - 1;
    ensures b < 0 && a < 0 ==> \result >= 0 && 2 * \result <= -a; */
static inline int32_t anhyst_scale(int32_t a, int16_t b);

/*@ requires n <= 31;
    assigns \nothing; */
static inline int32_t anhyst_shl_q31(int32_t a, uint16_t n);

/*@ assigns \nothing;
    ensures 0 <= \result <= 32767; */
static inline int32_t anhyst_sat_u15(int32_t a);

/*@ assigns \nothing;
    ensures -268435456 <= \result <= 268435455; */
static inline int32_t anhyst_sat_q28(int32_t a);

/*@ assigns \nothing;
    ensures -1073741824 <= \result <= 1073741823; */
static inline int32_t anhyst_sat_q30(int32_t a);

/*@ assigns \nothing; */
static inline int16_t anhyst_round_q31(int32_t a);

/*@ requires a > 0;
    assigns \nothing;
    ensures \result <= 30; */
static inline uint16_t anhyst_headroom(int32_t a);

#include "anhyst/numeric/fixed.h"
