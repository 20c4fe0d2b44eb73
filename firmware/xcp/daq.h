/* SPDX-License-Identifier: Apache-2.0 */
/* Lists of signals (DAQ lists) that are sampled at the end of a tick and queued for sending.

   A list has parts (ODTs) of one packet each; a part has entries of one signal each. Each master
   allocates lists, then parts, then entries. A sample of a list is complete: if the queue has no
   space for all its packets, the sample is dropped and counted.

   The tick writes the queue and the poll reads it; the tick may interrupt the poll. */
#ifndef ANHYST_XCP_DAQ_H
#define ANHYST_XCP_DAQ_H

#include "link/frames.h"
#include "port/port.h"
#include "xcp/map.h"

/* XCP error codes. */
#define XCP_OK 0U
#define XCP_ERR_DAQ_ACTIVE 0x11U
#define XCP_ERR_UNKNOWN_COMMAND 0x20U
#define XCP_ERR_SYNTAX 0x21U
#define XCP_ERR_RANGE 0x22U
#define XCP_ERR_WRITE_PROTECTED 0x23U
#define XCP_ERR_DENIED 0x24U
#define XCP_ERR_LOCKED 0x25U
#define XCP_ERR_PAGE 0x26U
#define XCP_ERR_MODE 0x27U
#define XCP_ERR_SEGMENT 0x28U
#define XCP_ERR_SEQUENCE 0x29U
#define XCP_ERR_DAQ_CONFIG 0x2AU
#define XCP_ERR_NO_MEMORY 0x30U

/* Bytes of a packet before the signals: number of the part, number of the list. */
#define XCP_DAQ_HEADER_BYTES 2U
#define XCP_DAQ_TIMESTAMP_BYTES 4U /* bytes of the tick number, in the first packet of a list */

typedef char xcp_all_entries_fit_into_a_packet[2 + 4 + 4 * XCP_ENTRIES <= XCP_PACKET ? 1 : -1];

typedef struct {
  uint8_t first;
  uint8_t count;
} xcp_range;

typedef struct {
  xcp_range parts;
  uint8_t prescaler;       /* samples every n-th tick */
  uint8_t remaining_ticks; /* ticks until the next sample */
  uint8_t is_selected;
  uint8_t is_running;
} xcp_list;

typedef struct {
  const struct port *port; /* provides the lock against the tick */
  xcp_list list[XCP_LISTS];
  xcp_range part[XCP_ODTS];    /* entries of each part */
  uint8_t signal[XCP_ENTRIES]; /* signal number of each entry, or XCP_NO_SIGNAL */
  uint8_t allocation_stage;    /* stage of allocation */
  uint8_t lists;
  uint8_t parts;
  uint8_t entries;
  uint8_t next_list; /* position of the next written entry */
  uint8_t next_part;
  uint8_t next_entry;
  uint16_t dropped_samples; /* dropped samples, modulo 65536 */
  uint16_t head;            /* write position of the tick */
  uint16_t tail;            /* read position of the poll */
  uint8_t queue[XCP_QUEUE];
} xcp_daq;

#define XCP_NO_SIGNAL 0xFFU

/* Resets to no lists and an empty queue. */
void xcp_daq_start(xcp_daq *d);

/* Samples the running lists. Call it in the tick. */
void xcp_daq_tick(xcp_daq *d, uint32_t tick, const int32_t *signals);

/* Moves the oldest packet to `packet` if it has at most `size` bytes. Returns its length, or 0. */
uint16_t xcp_daq_take(xcp_daq *d, uint8_t *packet, uint16_t size);

/* Stops and frees all lists. */
void xcp_daq_free(xcp_daq *d);

/* The following functions return XCP_OK, or an error; then nothing has changed. */
uint8_t xcp_daq_alloc_lists(xcp_daq *d, uint16_t count);
uint8_t xcp_daq_alloc_parts(xcp_daq *d, uint16_t list, uint8_t count);
uint8_t xcp_daq_alloc_entries(xcp_daq *d, uint16_t list, uint8_t part, uint8_t count);
uint8_t xcp_daq_set_position(xcp_daq *d, uint16_t list, uint8_t part, uint8_t entry);
uint8_t xcp_daq_write(xcp_daq *d, uint8_t signal);
uint8_t xcp_daq_clear(xcp_daq *d, uint16_t list);
uint8_t xcp_daq_set_prescaler(xcp_daq *d, uint16_t list, uint8_t prescaler);

/* mode: 0 stops the list, 1 starts it, 2 selects it for xcp_daq_synchronise. */
uint8_t xcp_daq_start_stop(xcp_daq *d, uint16_t list, uint8_t mode);

/* mode: 0 stops all lists, 1 starts the selected lists, 2 stops them. Clears the selection. */
uint8_t xcp_daq_synchronise(xcp_daq *d, uint8_t mode);

int xcp_daq_is_running(const xcp_daq *d);

#endif
