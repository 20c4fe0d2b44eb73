/* SPDX-License-Identifier: Apache-2.0 */
/* CRC-32 (IEEE 802.3, reflected) of a parameter block, without a table. The bits of every word
   count, low byte first. The two words of the checksum itself are left out. */
#ifndef ANHYST_CHECKSUM_H
#define ANHYST_CHECKSUM_H

#include <stdint.h>

#define ANHYST_CHECKSUM_START 0xFFFFFFFFUL /* the checksum is the complement of the last sum */

/* Adds 16 bits to a sum. */
static inline uint32_t anhyst_checksum_add(uint32_t sum, uint16_t bits)
{
  sum ^= bits;
  for (uint16_t bit = 0; bit < 16U; bit++) {
    sum = (sum & 1U) != 0U ? (sum >> 1) ^ 0xEDB88320UL : sum >> 1;
  }
  return sum;
}

#endif
