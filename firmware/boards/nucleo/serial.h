/* SPDX-License-Identifier: Apache-2.0 */
/* The two serial ports, 921600 baud, 8N1. They receive by DMA, because a tick takes longer than a
   byte, and send by interrupt.

       PA2, PA3    link, USART2, through the USB port of the board's ST-Link
       PC10, PC11  XCP, UART4: transmit, receive (CN7) */
#ifndef SERIAL_H
#define SERIAL_H

#include <stdint.h>

#define SERIAL_RING_BYTES 2048U /* bytes of a ring buffer, a power of two; 22 ms of the line */

typedef struct {
  uint32_t port_registers;                      /* base address of its registers */
  uint32_t dma_stream;                          /* base address of its DMA stream */
  volatile uint8_t received[SERIAL_RING_BYTES]; /* circular buffer, written by DMA */
  uint16_t read_index;
  volatile uint8_t to_send[SERIAL_RING_BYTES];
  volatile uint16_t send_head; /* written only by main */
  volatile uint16_t send_tail; /* written only by the interrupt */
} serial;

extern serial serial_link;
extern serial serial_xcp;

/* Starts both ports: pins, clocks, interrupts. Call it once. */
void serial_start(void);

/* link_read and link_write of a struct port; context: one of the two ports. */
uint16_t serial_read(void *context, uint8_t *bytes, uint16_t size);
uint16_t serial_write(void *context, const uint8_t *bytes, uint16_t count);

/* Interrupt handlers of the ports. */
void serial_link_ready(void);
void serial_xcp_ready(void);

#endif
