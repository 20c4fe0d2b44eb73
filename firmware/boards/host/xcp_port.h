/* SPDX-License-Identifier: Apache-2.0 */
/* XCP on TCP for the board that is a process. One master at a time. */
#ifndef HOST_XCP_PORT_H
#define HOST_XCP_PORT_H

#include <poll.h>

#include "app/app.h"

/* Takes over a socket that listens. */
void xcp_port_start(app *firmware, int listening);

/* What to wait for: the descriptor -1 where there is no port. */
struct pollfd xcp_port_wanted(void);

/* Takes in what has come and sends what waits, without waiting itself. */
void xcp_port_serve(void);

/* A tick is over. */
void xcp_port_tick(void);

#endif
