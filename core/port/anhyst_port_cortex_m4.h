/* SPDX-License-Identifier: Apache-2.0 */
/* Instructions of Cortex-M4 and M7 (ARMv7E-M) for port.h, for gcc and clang:

     cc -mcpu=cortex-m4 -DANHYST_PORT_HEADER='"anhyst_port_cortex_m4.h"' ...

   Each instruction returns the same bits as the portable code. QADD, QSUB, SSAT and USAT set the
   sticky Q flag of the status register if they saturate; nothing here reads it. */
#ifndef ANHYST_PORT_CORTEX_M4_H
#define ANHYST_PORT_CORTEX_M4_H

#include <stdint.h>

/* floor(a*b/65536). SMULWB uses only the low half of b, as a signed number. */
static inline int32_t anhyst_port_smulwb(int32_t a, int16_t b)
{
  int32_t result;
  __asm__("smulwb %0, %1, %2" : "=r"(result) : "r"(a), "r"(b));
  return result;
}

/* a + b, saturating. */
static inline int32_t anhyst_port_qadd(int32_t a, int32_t b)
{
  int32_t result;
  __asm__("qadd %0, %1, %2" : "=r"(result) : "r"(a), "r"(b));
  return result;
}

/* a - b, saturating. */
static inline int32_t anhyst_port_qsub(int32_t a, int32_t b)
{
  int32_t result;
  __asm__("qsub %0, %1, %2" : "=r"(result) : "r"(a), "r"(b));
  return result;
}

/* Saturates to 16 bits, signed. */
static inline int32_t anhyst_port_ssat16(int32_t a)
{
  int32_t result;
  __asm__("ssat %0, #16, %1" : "=r"(result) : "r"(a));
  return result;
}

/* Saturates to 29 bits, signed. */
static inline int32_t anhyst_port_ssat29(int32_t a)
{
  int32_t result;
  __asm__("ssat %0, #29, %1" : "=r"(result) : "r"(a));
  return result;
}

/* Saturates to 31 bits, signed. */
static inline int32_t anhyst_port_ssat31(int32_t a)
{
  int32_t result;
  __asm__("ssat %0, #31, %1" : "=r"(result) : "r"(a));
  return result;
}

/* Saturates to 15 bits, unsigned. */
static inline int32_t anhyst_port_usat15(int32_t a)
{
  int32_t result;
  __asm__("usat %0, #15, %1" : "=r"(result) : "r"(a));
  return result;
}

/* Number of leading zeros, 0..32. */
static inline int32_t anhyst_port_clz(uint32_t u)
{
  int32_t result;
  __asm__("clz %0, %1" : "=r"(result) : "r"(u));
  return result;
}

#define ANHYST_PORT_SCALE(a, b) anhyst_port_smulwb((a), (b))
#define ANHYST_PORT_ADD_Q31(a, b) anhyst_port_qadd((a), (b))
#define ANHYST_PORT_SUB_Q31(a, b) anhyst_port_qsub((a), (b))
#define ANHYST_PORT_SAT_Q15(a) anhyst_port_ssat16((a))
#define ANHYST_PORT_SAT_Q28(a) anhyst_port_ssat29((a))
#define ANHYST_PORT_SAT_Q30(a) anhyst_port_ssat31((a))
#define ANHYST_PORT_SAT_U15(a) anhyst_port_usat15((a))
#define ANHYST_PORT_LEADING_ZEROS(u) anhyst_port_clz((u))

#endif
