/* SPDX-License-Identifier: Apache-2.0 */
/* The two serial ports, 921600 baud, 8N1. Bytes arrive by DMA, since a tick takes longer than a
   byte, and are sent by interrupt.

     PA2, PA3    link, serial port 2, through the USB port of the board's ST-Link
     PC10, PC11  XCP, serial port 4: what the board sends, and what it receives (CN7) */
#ifndef SERIAL_H
#define SERIAL_H

#include <stdint.h>

#define SERIAL_RING 2048U /* a power of two; 22 ms of the line */

typedef struct {
  uint32_t port;                          /* where its registers begin */
  uint32_t stream;                        /* where those of its DMA begin */
  volatile uint8_t received[SERIAL_RING]; /* written by DMA, round and round */
  uint16_t read_at;
  volatile uint8_t to_send[SERIAL_RING];
  volatile uint16_t send_head; /* only main moves it */
  volatile uint16_t send_tail; /* only the interrupt does */
} serial;

extern serial serial_link;
extern serial serial_xcp;

/* Once, both: pins, clocks, interrupts. */
void serial_start(void);

/* As link_read and link_write of a struct port whose context is one of the two. */
uint16_t serial_read(void *context, uint8_t *bytes, uint16_t most);
uint16_t serial_write(void *context, const uint8_t *bytes, uint16_t count);

/* Interrupts of the ports. */
void serial_link_ready(void);
void serial_xcp_ready(void);

#endif
