/* SPDX-License-Identifier: Apache-2.0 */
/* Processor-specific instructions, and the requirements on every compiler.

   The fixed-point core needs 16- and 32-bit two's complement integers. The core uses no 8-bit type
   and, except in wide.h, no 64-bit type. The core does not depend on the width of int. The option
   -DANHYST_PORT_HEADER='"anhyst_port_cortex_m4.h"' makes the compiler use special instructions of a
   processor (folder core/port). A port header may define any of these macros:

     ANHYST_PORT_SCALE(a, b)  floor(a*b/65536) for int32_t a, int16_t b
     ANHYST_PORT_ADD_Q31(a, b), ANHYST_PORT_SUB_Q31(a, b)  saturating sum, difference; int32_t
     ANHYST_PORT_SAT_Q15(a), ANHYST_PORT_SAT_Q28(a), ANHYST_PORT_SAT_Q30(a),
     ANHYST_PORT_SAT_U15(a)   int32_t saturated to 16, 29 and 31 bits, signed, and to 15 bits,
                              unsigned
     ANHYST_PORT_LEADING_ZEROS(u)  number of leading zeros of a uint32_t above 0, 0..31

   The macros must return the same bits as the portable code. The tests compare the results. */
#ifndef ANHYST_PORT_H
#define ANHYST_PORT_H

#include <stdint.h>

#ifdef ANHYST_PORT_HEADER
#include ANHYST_PORT_HEADER
#endif

/* An optional check of the order of calls. The check is off unless the compiler option
   -D'ANHYST_ASSERT(is_true)=assert(is_true)' defines an assertion. The check detects an interrupt
   that calls solve, commit or swap during another such call for the same compensator. */
#ifdef ANHYST_ASSERT
#define ANHYST_HAS_ASSERT 1
#else
#define ANHYST_HAS_ASSERT 0
#endif

/* In C99, the right shift of a negative number is implementation-defined. All known compilers for
   embedded processors keep the sign. With any other compiler, this line causes an error. */
typedef char anhyst_right_shift_keeps_the_sign[((int32_t)-3 >> 1) == -2 ? 1 : -1];

#endif
