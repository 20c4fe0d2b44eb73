/* SPDX-License-Identifier: Apache-2.0 */
/* Products and limits of 64 bits: no overflow, and the contracts state the results as exact
   integers. proofs/esbmc/wide.h uses the contract of anhyst_wide. */
#include <stdint.h>

/*@ assigns \nothing;
    ensures a >= 0 ==> -2147483648 * a <= \result <= 2147483648 * a;
    ensures a < 0 ==> 2147483648 * a <= \result <= -2147483648 * a; */
static inline int64_t anhyst_wide(int32_t a, int32_t b);

/*@ assigns \nothing;
    ensures \result == (a > 2147483647 ? 2147483647 : a < -2147483648 ? -2147483648 : a); */
static inline int32_t anhyst_sat_wide(int64_t a);

/*@ requires most >= 0;
    assigns \nothing;
    ensures \result == (a > most ? most : a < -most ? -most : a); */
static inline int64_t anhyst_clamp_wide(int64_t a, int64_t most);

#include "anhyst/numeric/wide.h"
