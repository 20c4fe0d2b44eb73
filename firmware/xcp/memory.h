/* SPDX-License-Identifier: Apache-2.0 */
/* Access to the virtual addresses of XCP. */
#ifndef ANHYST_XCP_MEMORY_H
#define ANHYST_XCP_MEMORY_H

#include "xcp/xcp.h"

/* Reads bytes from an address on. Returns XCP_OK, XCP_ERR_RANGE or XCP_ERR_DENIED. */
uint8_t xcp_read(const xcp_slave *x, uint32_t address, uint8_t *bytes, uint32_t count);

/* Writes one value of four bytes, or complete words of page 1. Returns XCP_OK, XCP_ERR_RANGE,
   XCP_ERR_DENIED or XCP_ERR_WRITE_PROTECTED. *reason: answer of the firmware, LINK_REASON_... */
uint8_t xcp_write(xcp_slave *x, uint32_t address, const uint8_t *bytes, uint16_t count,
                  uint16_t *reason);

/* Returns the signal number of an address, or XCP_NO_SIGNAL. */
uint8_t xcp_signal_at(uint32_t address);

#endif
