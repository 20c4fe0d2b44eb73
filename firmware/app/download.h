/* SPDX-License-Identifier: Apache-2.0 */
/* Receives a parameter block in several parts and checks it before it is used. There are two
   buffers. The active block is never written; a download goes to the other (pending) buffer. */
#ifndef ANHYST_FIRMWARE_DOWNLOAD_H
#define ANHYST_FIRMWARE_DOWNLOAD_H

#include "app/board.h"
#include "link/frames.h"

/* Content of the pending buffer. */
#define APP_DOWNLOAD_NONE 0U      /* nothing, or a block that is now active */
#define APP_DOWNLOAD_RECEIVING 1U /* the received words of an announced block */
#define APP_DOWNLOAD_EDITED 2U    /* a copy of the active block that is changed word by word */

typedef struct {
  link_block_begin announced;
  uint32_t checksum;       /* CRC-32 of the received words */
  uint16_t received_words; /* number of received words */
  uint16_t pending_index;  /* index of the pending buffer */
  uint16_t state;          /* one of APP_DOWNLOAD_... */
  uint16_t has_checksum;   /* whether an edit wrote the checksum of the block */
  int16_t words[2][ANHYST_BLOCK_MOST_WORDS];
} app_download;

void app_download_start(app_download *download);

/* Announces a block. in_force is the active block. Returns LINK_REASON_NONE, or _VALUE if the
   announced block is too short or too long. */
uint16_t app_download_begin(app_download *download, const link_block_begin *begin,
                            const int16_t *in_force);

/* Receives the next `count` words of two bytes each. Returns LINK_REASON_NONE, or _ORDER if the
   offset is wrong or the words exceed the announced length. */
uint16_t app_download_words(app_download *download, uint16_t offset, const uint8_t *bytes,
                            uint16_t count);

/* Changes `count` words of the edited block, which starts as a copy of the active block. Returns
   LINK_REASON_NONE; _ORDER during a download; _VALUE beyond the end of the buffer. */
uint16_t app_download_edit(app_download *download, const int16_t *in_force, uint16_t at,
                           const uint8_t *bytes, uint16_t count);

/* Marks the edited block as received. Calculates the checksum of the block, unless an edit wrote
   one; that checksum is checked later. */
void app_download_finish_edit(app_download *download);

/* Checks the received block. Returns LINK_REASON_NONE, with the block in *words and its length in
   announced.words; or LINK_REASON_ORDER, _CHECKSUM, _BLOCK, _GENERATION, _SCALE (*detail: first
   word that differs from the board's). Must not be called from an ISR: it reads every word. */
uint16_t app_download_check(const app_download *download, const app_board *board,
                            uint16_t generation, const int16_t **words, uint16_t *detail);

#endif
