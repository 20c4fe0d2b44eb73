/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes numbers in byte arrays, low byte first, on any processor. */
#ifndef ANHYST_LINK_BYTES_H
#define ANHYST_LINK_BYTES_H

#include <stdint.h>

static inline void link_put_u8(uint8_t *p, uint8_t value) { *p = value; }

static inline void link_put_u16(uint8_t *p, uint16_t value)
{
  p[0] = (uint8_t)(value & 0xFFU);
  p[1] = (uint8_t)(value >> 8);
}

static inline void link_put_u32(uint8_t *p, uint32_t value)
{
  link_put_u16(p, (uint16_t)(value & 0xFFFFU));
  link_put_u16(p + 2, (uint16_t)(value >> 16));
}

static inline uint16_t link_get_u16(const uint8_t *p)
{
  return (uint16_t)(p[0] | ((uint16_t)p[1] << 8));
}

static inline uint32_t link_get_u32(const uint8_t *p)
{
  return link_get_u16(p) | ((uint32_t)link_get_u16(p + 2) << 16);
}

/* Two's complement without an implementation-defined conversion. */
static inline int16_t link_get_i16(const uint8_t *p)
{
  const uint16_t value = link_get_u16(p);
  return value < 0x8000U ? (int16_t)value : (int16_t)((int32_t)value - 0x10000);
}

static inline int32_t link_get_i32(const uint8_t *p)
{
  const uint32_t value = link_get_u32(p);
  return value <= (uint32_t)INT32_MAX ? (int32_t)value : -(int32_t)(UINT32_MAX - value) - 1;
}

#endif
