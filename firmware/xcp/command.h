/* SPDX-License-Identifier: Apache-2.0 */
/* Commands of XCP as the slave looks them up. */
#ifndef ANHYST_XCP_COMMAND_H
#define ANHYST_XCP_COMMAND_H

#include "xcp/xcp.h"

/* What an answer is made of. */
typedef struct {
  uint8_t *bytes; /* the first says that it is an answer */
  uint16_t length;
  uint16_t reason; /* of the firmware, where it refused */
} xcp_reply;

/* Does a command of n bytes, `c`: fills the answer, or returns the error. */
typedef uint8_t xcp_action(xcp_slave *x, const uint8_t *c, uint16_t n, xcp_reply *to);

typedef struct {
  uint8_t code;
  uint8_t least;     /* bytes it has */
  uint8_t wants_key; /* whether it is refused without */
  xcp_action *act;
} xcp_command;

/* The command with this code, or NULL: of lists of samples. */
const xcp_command *xcp_daq_command(uint8_t code);

#endif
