/* SPDX-License-Identifier: Apache-2.0 */
/* A parameter block that arrives piece by piece, is checked as a whole and only then used. The
   block in force is never written to: there are two places, and a download goes to the other. */
#ifndef ANHYST_FIRMWARE_DOWNLOAD_H
#define ANHYST_FIRMWARE_DOWNLOAD_H

#include "app/board.h"
#include "link/frames.h"

/* What the free place holds. */
#define APP_DOWNLOAD_NONE 0U     /* nothing, or the block in force */
#define APP_DOWNLOAD_ARRIVING 1U /* a block that was announced, as far as it has arrived */
#define APP_DOWNLOAD_EDITED 2U   /* a copy of the block in force that is changed word by word */

typedef struct {
  link_block_begin announced;
  uint32_t checksum;  /* of the words so far */
  uint16_t received;  /* words so far */
  uint16_t place;     /* that they go to */
  uint16_t under_way; /* one of APP_DOWNLOAD_... */
  uint16_t sealed;    /* whether an edit wrote the block's own checksum */
  int16_t words[2][ANHYST_BLOCK_MOST_WORDS];
} app_download;

void app_download_start(app_download *download);

/* Announces a block; in_force: the words used now. LINK_REASON_NONE, or LINK_REASON_VALUE where its
   length cannot be that of a block. */
uint16_t app_download_begin(app_download *download, const link_block_begin *begin,
                            const int16_t *in_force);

/* Takes the next words, `count` of them, two bytes each. LINK_REASON_NONE, or LINK_REASON_ORDER
   where they are not the next ones or more than were announced. */
uint16_t app_download_words(app_download *download, uint16_t offset, const uint8_t *bytes,
                            uint16_t count);

/* Changes words, `count` of them, of the block under edit, which begins as a copy of the block in
   force. LINK_REASON_NONE; _ORDER while another arrives piece by piece; _VALUE beyond its place. */
uint16_t app_download_edit(app_download *download, const int16_t *in_force, uint16_t at,
                           const uint8_t *bytes, uint16_t count);

/* Takes the block under edit for one that has arrived, to be checked. Its checksum is computed anew
   unless an edit wrote it: then that is checked too. */
void app_download_seal(app_download *download);

/* Checks what has arrived. LINK_REASON_NONE: *words is a valid block for this board, its length in
   announced.words; or LINK_REASON_ORDER, _CHECKSUM, _BLOCK, _GENERATION, _SCALE: in *detail the
   first word that is another on this board. Reads every word: not for an interrupt. */
uint16_t app_download_check(const app_download *download, const app_board *board,
                            uint16_t generation, const int16_t **words, uint16_t *detail);

#endif
