/* SPDX-License-Identifier: Apache-2.0 */
/* CRC-32 (IEEE 802.3, reflected) of a parameter block, without a table. The checksum covers every
   word, low byte first, except the two words of the checksum itself. */
#ifndef ANHYST_CHECKSUM_H
#define ANHYST_CHECKSUM_H

#include <stdint.h>

/* Initial value of the checksum. The stored checksum is the complement of the final value. */
#define ANHYST_CHECKSUM_START 0xFFFFFFFFUL

/* Adds 16 bits to a running checksum. */
static inline uint32_t anhyst_checksum_add(uint32_t sum, uint16_t bits)
{
  sum ^= bits;
  for (uint16_t bit = 0; bit < 16U; bit++) {
    sum = (sum & 1U) != 0U ? (sum >> 1) ^ 0xEDB88320UL : sum >> 1;
  }
  return sum;
}

#endif
