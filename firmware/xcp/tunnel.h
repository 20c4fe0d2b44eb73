/* SPDX-License-Identifier: Apache-2.0 */
/* XCP inside link frames. A request contains a command, or nothing if only samples are requested.
   Its answer contains packets of the slave, each after its length in one byte: first the answer to
   the command, then events and samples that fit. The link keeps the order and repeats lost data. */
#ifndef ANHYST_XCP_TUNNEL_H
#define ANHYST_XCP_TUNNEL_H

#include "xcp/xcp.h"

#if XCP_PACKET + 1 > LINK_MAX_PAYLOAD
#error "an answer does not fit into a frame"
#endif

/* Writes up to LINK_MAX_PAYLOAD bytes of packets and returns their number. */
uint16_t xcp_tunnel(xcp_slave *x, const uint8_t *command, uint16_t length, uint8_t *packets);

#endif
