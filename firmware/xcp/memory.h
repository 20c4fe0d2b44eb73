/* SPDX-License-Identifier: Apache-2.0 */
/* Virtual addresses of XCP: what is read and written there. */
#ifndef ANHYST_XCP_MEMORY_H
#define ANHYST_XCP_MEMORY_H

#include "xcp/xcp.h"

/* Bytes from an address on: XCP_FINE, or XCP_RANGE or XCP_DENIED. */
uint8_t xcp_read(const xcp_slave *x, uint32_t address, uint8_t *bytes, uint32_t count);

/* Writes one value of four bytes, or whole words of the next block: XCP_FINE, or XCP_RANGE,
   XCP_DENIED, XCP_WRITE_PROTECTED; *reason is what the firmware says, one of LINK_REASON_... */
uint8_t xcp_write(xcp_slave *x, uint32_t address, const uint8_t *bytes, uint16_t count,
                  uint16_t *reason);

/* The signal at an address, or XCP_NO_SIGNAL. */
uint8_t xcp_signal_at(uint32_t address);

#endif
