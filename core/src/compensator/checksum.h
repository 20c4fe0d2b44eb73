/* SPDX-License-Identifier: Apache-2.0 */
/* CRC-32 (IEEE 802.3, reflected) without a table: about 100 instructions a word. */
#ifndef ANHYST_CHECKSUM_H
#define ANHYST_CHECKSUM_H

#include <stdint.h>

#define ANHYST_CHECKSUM_START 0xFFFFFFFFUL /* the result is XORed with it, too */

/* Goes on by one word of 16 bits, low byte first. */
static inline uint32_t anhyst_checksum_word(uint32_t sum, uint16_t word)
{
  sum ^= word;
  for (uint16_t bit = 0; bit < 16U; bit++) {
    sum = (sum & 1U) != 0U ? (sum >> 1) ^ 0xEDB88320UL : sum >> 1;
  }
  return sum;
}

#endif
