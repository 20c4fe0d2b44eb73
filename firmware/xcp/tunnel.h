/* SPDX-License-Identifier: Apache-2.0 */
/* XCP inside frames of the own link: a request carries a command, or nothing where only samples are
   wanted; its answer the packets of the slave, one behind the other, each with its length in front,
   one byte: first what the command is answered with, then events and samples as far as there is
   room. The link's own rules keep the order and repeat what was lost. */
#ifndef ANHYST_XCP_TUNNEL_H
#define ANHYST_XCP_TUNNEL_H

#include "xcp/xcp.h"

#if XCP_PACKET + 1 > LINK_PAYLOAD_MOST
#error "an answer does not fit into a frame"
#endif

/* Writes packets, LINK_PAYLOAD_MOST bytes at the most: how many bytes. */
uint16_t xcp_tunnel(xcp_slave *x, const uint8_t *command, uint16_t length, uint8_t *packets);

#endif
