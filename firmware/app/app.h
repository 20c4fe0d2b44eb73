/* SPDX-License-Identifier: Apache-2.0 */
/* The firmware without its hardware. A board includes this file, fills a struct port (port/port.h)
   and provides the memory. It calls app_start once, app_tick in every tick and app_poll between
   ticks. The complete state is in the two objects below, so a board may have several controllers.

       static app firmware;
       static app_body body;
       app_start(&firmware, &body, &board, &port);
       for (;;) {
         if (a tick has begun) {
           app_tick(&firmware);       (or from the interrupt of the tick)
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
  uint8_t chunk[32];                          /* bytes read from the port, not yet decoded */
  uint8_t answer[LINK_MAX_ENCODED_FRAME];     /* answer to the last request, for its repetition */
  uint8_t unrepeated[LINK_MAX_ENCODED_FRAME]; /* an answer that is never repeated */
  const uint8_t *next_byte;                   /* next unsent byte of answer or unrepeated */
  uint32_t request_crc;   /* CRC-32 of the last request, to identify its repetition */
  uint32_t answered_mask; /* bit n: request number last_sequence - n was answered */
  uint16_t chunk_count;
  uint16_t chunk_index;
  uint16_t answer_count;
  uint16_t unsent_count;   /* bytes still to be sent */
  uint32_t session_number; /* number of the open session */
  uint16_t last_sequence;  /* sequence number of the last request */
  uint16_t is_open;        /* whether a session is open */
  uint16_t lost_requests;  /* skipped sequence numbers, modulo 65536 */
} app_session;

struct app {
  const struct port *port;
  const app_board *board;
  app_control control;
  int32_t settings[LINK_SETTING_COUNT];
  int32_t signals[LINK_SIGNAL_COUNT]; /* signals of the last tick */
  app_session session;
  app_download download;
  xcp_slave carried; /* XCP slave for packets inside link frames */
  uint32_t
      max_tick_cycles; /* CPU cycles of the longest tick; written by boards that count cycles */
};

/* Starts in the state INIT. Checks the built-in block: about 100 instructions per word. */
void app_start(app *a, app_body *body, const app_board *board, const struct port *port);

/* Runs one tick of the control task: reads the sample and sets the current. The work does not
   depend on state or sample, with two exceptions: the commit of the compensator is shorter if the
   solved current was applied, and an XCP master can request samples. */
void app_tick(app *a);

/* Sends the rest of an answer first. Then reads bytes from the port and answers the requests in
   them, until the port accepts no more bytes or all bytes of one read are processed. */
void app_poll(app *a);

/* Performs a request and writes the payload of its answer (up to LINK_MAX_PAYLOAD bytes). Returns
   the type of the answer, and in *length the bytes of its payload. Every request has an answer. */
uint8_t app_answer(app *a, const link_frame *request, uint8_t *payload, uint8_t *length);

#endif
