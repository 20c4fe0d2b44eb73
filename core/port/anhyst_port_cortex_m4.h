/* SPDX-License-Identifier: Apache-2.0 */
/* The instructions of Cortex-M4 and M7 (ARMv7E-M) for port.h, for gcc and clang:
     cc -mcpu=cortex-m4 -DANHYST_PORT_HEADER='"anhyst_port_cortex_m4.h"' ...
   Each gives the same bits as the portable code. QADD and QSUB set the sticky Q flag of the status
   register where they saturate; nothing here reads it. */
#ifndef ANHYST_PORT_CORTEX_M4_H
#define ANHYST_PORT_CORTEX_M4_H

#include <stdint.h>

/* floor(a*b/65536): SMULWB takes the low half of b, sign included, whatever stands above it. */
static inline int32_t anhyst_port_smulwb(int32_t a, int16_t b)
{
  int32_t result;
  __asm__("smulwb %0, %1, %2" : "=r"(result) : "r"(a), "r"(b));
  return result;
}

/* a + b, saturates. */
static inline int32_t anhyst_port_qadd(int32_t a, int32_t b)
{
  int32_t result;
  __asm__("qadd %0, %1, %2" : "=r"(result) : "r"(a), "r"(b));
  return result;
}

/* a - b, saturates. */
static inline int32_t anhyst_port_qsub(int32_t a, int32_t b)
{
  int32_t result;
  __asm__("qsub %0, %1, %2" : "=r"(result) : "r"(a), "r"(b));
  return result;
}

/* Leading zeros, 0..32. */
static inline int32_t anhyst_port_clz(uint32_t u)
{
  int32_t result;
  __asm__("clz %0, %1" : "=r"(result) : "r"(u));
  return result;
}

#define ANHYST_PORT_SCALE(a, b) anhyst_port_smulwb((a), (b))
#define ANHYST_PORT_ADD_Q31(a, b) anhyst_port_qadd((a), (b))
#define ANHYST_PORT_SUB_Q31(a, b) anhyst_port_qsub((a), (b))
#define ANHYST_PORT_LEADING_ZEROS(u) anhyst_port_clz((u))

#endif
