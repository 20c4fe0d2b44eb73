/* SPDX-License-Identifier: Apache-2.0 */
#ifndef ANHYST_LINK_CRC_H
#define ANHYST_LINK_CRC_H

#include <stdint.h>

/* Returns the CRC-32 of IEEE 802.3 (as in zip), continued from `crc`, which is 0 at the start.
   Detects every burst of up to 32 bits, and all other errors except one in 2^32. */
uint32_t link_crc32(uint32_t crc, const uint8_t *bytes, uint16_t count);

#endif
