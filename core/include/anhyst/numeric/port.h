/* SPDX-License-Identifier: Apache-2.0 */
/* What a processor may do better than portable C, and what this code asks of every compiler.

   The fixed-point core needs 16- and 32-bit two's complement integers, nothing else: no 8-bit
   type, no 64-bit type, no assumption about the width of int. A compiler is told to take a
   processor's own instructions by -DANHYST_PORT_HEADER='"anhyst_port_cortex_m4.h"' (see
   port/). Such a header may define any of

     ANHYST_PORT_SCALE(a, b)  floor(a*b/65536) for int32_t a, int16_t b
     ANHYST_PORT_ADD_Q31(a, b), ANHYST_PORT_SUB_Q31(a, b)  saturating, int32_t
     ANHYST_PORT_SAT_Q15(a), ANHYST_PORT_SAT_Q28(a), ANHYST_PORT_SAT_Q30(a),
     ANHYST_PORT_SAT_U15(a)   the nearest number of 16, 29 and 31 bits, signed, and of 15 bits,
                              unsigned, to an int32_t
     ANHYST_PORT_LEADING_ZEROS(u)  of a uint32_t that is not zero, 0..31

   and must give the same bits as the portable code: the tests compare them. */
#ifndef ANHYST_PORT_H
#define ANHYST_PORT_H

#include <stdint.h>

#ifdef ANHYST_PORT_HEADER
#include ANHYST_PORT_HEADER
#endif

/* A check of how the functions are called, off unless the compiler is given another definition:
   -D'ANHYST_ASSERT(is_true)=assert(is_true)'. It finds a call of solve, commit or swap from an
   interrupt inside another call for the same compensator. */
#ifdef ANHYST_ASSERT
#define ANHYST_HAS_ASSERT 1
#else
#define ANHYST_HAS_ASSERT 0
#endif

/* C99 leaves the right shift of a negative number to the compiler. All that are known for embedded
   targets keep the sign; this line does not compile where one does not. */
typedef char anhyst_right_shift_keeps_the_sign[((int32_t)-3 >> 1) == -2 ? 1 : -1];

#endif
