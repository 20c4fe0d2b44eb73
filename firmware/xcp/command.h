/* SPDX-License-Identifier: Apache-2.0 */
/* Table entries of XCP commands. */
#ifndef ANHYST_XCP_COMMAND_H
#define ANHYST_XCP_COMMAND_H

#include "xcp/xcp.h"

#define XCP_CLEARED_ANSWER_BYTES 8U /* bytes of an answer that are set to 0 before each command */

/* A command and its answer. */
typedef struct {
  const uint8_t *command;
  uint16_t count;  /* bytes of the received command */
  uint8_t *answer; /* the answer; unused bytes of its head are 0 */
  uint16_t length;
  uint16_t reason; /* LINK_REASON_... if the firmware refused */
} xcp_request;

/* Performs a command: fills the answer, or returns the XCP error. */
typedef uint8_t xcp_action(xcp_slave *x, xcp_request *r);

typedef struct {
  uint8_t code;
  uint8_t min_bytes; /* minimum length of the command, bytes */
  uint8_t needs_key; /* whether the command needs the key */
  xcp_action *act;
} xcp_command;

/* Returns the command for sample lists with this code, or NULL. */
const xcp_command *xcp_daq_command(uint8_t code);

#endif
