/* SPDX-License-Identifier: Apache-2.0 */
/* The firmware without its hardware: a board includes this, fills a struct port (port/port.h) and
   gives the memory; it calls app_start once, app_tick once every tick, app_poll in between. All
   that a controller remembers is in the two it is given, so that a board may have several.

     static app firmware;
     static app_body body;
     app_start(&firmware, &body, &board, &port);
     for (;;) {
       if (a tick has begun) {
         app_tick(&firmware);       (or from the tick's interrupt)
       }
       app_poll(&firmware);
     } */
#ifndef ANHYST_FIRMWARE_APP_H
#define ANHYST_FIRMWARE_APP_H

#include "app/board.h"
#include "app/control.h"
#include "app/download.h"
#include "app/settings.h"
#include "link/frame.h"
#include "port/port.h"
#include "xcp/xcp.h"

/* The session with a PC. */
typedef struct {
  link_receiver receiver;
  uint8_t chunk[32];              /* bytes taken from the port and not yet looked at */
  uint8_t answer[LINK_WIRE_MOST]; /* the answer to the last request, kept for its repetition */
  uint8_t aside[LINK_WIRE_MOST];  /* an answer that is not kept */
  const uint8_t *sending;         /* one of the two */
  uint32_t check;                 /* checksum of the last request, by which it is known again */
  uint32_t window;                /* bit n: number last - n was answered */
  uint16_t chunk_count;
  uint16_t chunk_at;
  uint16_t answer_count;
  uint16_t sending_count; /* bytes still to be sent */
  uint32_t number;        /* of the session that is open */
  uint16_t last;          /* sequence number of the last request */
  uint16_t open;          /* whether a session is open */
  uint16_t lost;          /* numbers left out, modulo 65536 */
} app_session;

struct app {
  const struct port *port;
  const app_board *board;
  app_control control;
  int32_t settings[LINK_SETTING_COUNT];
  int32_t signals[LINK_SIGNAL_COUNT]; /* of the last tick */
  app_session session;
  app_download download;
  xcp_slave carried; /* by the link */
  uint32_t cycles;   /* of the longest tick so far: a board that counts them puts them here */
};

/* Starts in the state init. Checks the block built in: about 100 instructions a word. */
void app_start(app *a, app_body *body, const app_board *board, const struct port *port);

/* One tick of the control task: sample in, current out. The same work in every state and for every
   sample but for what the compensator's commit saves where the solved current was applied, and for
   the samples that a master of XCP has ordered. */
void app_tick(app *a);

/* Sends what is left of an answer; when all is sent, takes bytes from the port and answers the
   requests in them, until an answer has to wait for the port or no byte is left of one chunk. */
void app_poll(app *a);

/* Does a request and writes the payload of its answer (LINK_PAYLOAD_MOST bytes): the answer's type,
   and in *length the bytes of its payload. Every request has one. */
uint8_t app_answer(app *a, const link_frame *request, uint8_t *payload, uint8_t *length);

#endif
