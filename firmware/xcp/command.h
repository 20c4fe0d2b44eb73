/* SPDX-License-Identifier: Apache-2.0 */
/* Commands of XCP as the slave looks them up. */
#ifndef ANHYST_XCP_COMMAND_H
#define ANHYST_XCP_COMMAND_H

#include "xcp/xcp.h"

#define XCP_ANSWER_HEAD 8U /* bytes of an answer that are 0 before a command is done */

/* A command, and what its answer is made of. */
typedef struct {
  const uint8_t *command;
  uint16_t count;  /* its bytes */
  uint8_t *answer; /* the first byte says that it is one; the other bytes of the head are 0 */
  uint16_t length;
  uint16_t reason; /* of the firmware, where it refused */
} xcp_request;

/* Does a command: fills the answer, or returns the error. */
typedef uint8_t xcp_action(xcp_slave *x, xcp_request *r);

typedef struct {
  uint8_t code;
  uint8_t least;     /* bytes it has */
  uint8_t wants_key; /* whether it is refused without */
  xcp_action *act;
} xcp_command;

/* The command with this code, or NULL: of lists of samples. */
const xcp_command *xcp_daq_command(uint8_t code);

#endif
