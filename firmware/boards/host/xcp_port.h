/* SPDX-License-Identifier: Apache-2.0 */
/* XCP on TCP for the host board. One master at a time. */
#ifndef HOST_XCP_PORT_H
#define HOST_XCP_PORT_H

#include <poll.h>

#include "app/app.h"

/* Takes ownership of a listening socket. */
void xcp_port_start(app *firmware, int listening);

/* Returns the events for which the caller polls; descriptor -1 if there is no port. */
struct pollfd xcp_port_wanted(void);

/* Processes received bytes and sends packets, without waiting. */
void xcp_port_serve(void);

/* Must be called after each tick. */
void xcp_port_tick(void);

#endif
