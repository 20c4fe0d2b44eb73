/* SPDX-License-Identifier: Apache-2.0 */
/* Board Arm MPS2 (AN385, Cortex-M3) in QEMU. UART0 is the link, UART1 the bus of the virtual plant,
   which gives the ticks, and UART2 carries XCP (XCP on TCP if QEMU connects it to a socket). All
   memory is static. The processor sleeps while idle. */
#include <stdint.h>

#include "lockstep.h"
#include "startup.h"
#include "xcp/line.h"

/* CMSDK UART, with a buffer of one byte in each direction. */
#define UART_LINK 0x40004000U
#define UART_PLANT 0x40005000U
#define UART_XCP 0x40006000U
#define UART_DATA(uart) REGISTER((uart) + 0x00U)
#define UART_STATE(uart) REGISTER((uart) + 0x04U)
#define UART_CONTROL(uart) REGISTER((uart) + 0x08U)
#define UART_INTERRUPT(uart) REGISTER((uart) + 0x0CU)
#define UART_DIVIDER(uart) REGISTER((uart) + 0x10U)

#define UART_TX_FULL 1U
#define UART_RX_FULL 2U
#define UART_TX_ENABLE 1U
#define UART_RX_ENABLE 2U
#define UART_TX_INTERRUPT_ENABLE 4U
#define UART_RX_INTERRUPT_ENABLE 8U
#define UART_TX_INTERRUPT 1U
#define UART_RX_INTERRUPT 2U
#define UART_MIN_DIVIDER 16U

#define IRQ_LINK_RX 0
#define IRQ_LINK_TX 1
#define IRQ_PLANT_RX 2
#define IRQ_XCP_RX 4
#define IRQ_XCP_TX 5

#define RING_BYTES 1024U /* ring size: a power of two, because indices wrap around */

/* Written by an interrupt, read by the main loop. */
typedef struct {
  volatile uint16_t head;
  volatile uint16_t tail;
  volatile uint8_t bytes[RING_BYTES];
} ring;

static lockstep controller;
static ring from_link;
static ring from_plant;
static ring from_xcp;
static xcp_line xcp;

/* Reads all bytes of the UART. Bytes that do not fit into the ring are lost, as on any line. */
static void receive(uint32_t uart, ring *to)
{
  UART_INTERRUPT(uart) = UART_RX_INTERRUPT;
  while ((UART_STATE(uart) & UART_RX_FULL) != 0U) {
    const uint8_t byte = (uint8_t)(UART_DATA(uart) & 0xFFU);
    if ((uint16_t)(to->head - to->tail) < RING_BYTES) {
      to->bytes[to->head % RING_BYTES] = byte;
      ++to->head;
    }
  }
}

static void receive_link(void) { receive(UART_LINK, &from_link); }
static void receive_plant(void) { receive(UART_PLANT, &from_plant); }
static void receive_xcp(void) { receive(UART_XCP, &from_xcp); }

/* Only wakes the main loop, which has more bytes to send. */
static void stop_tx_interrupt(uint32_t uart)
{
  UART_CONTROL(uart) &= ~UART_TX_INTERRUPT_ENABLE;
  UART_INTERRUPT(uart) = UART_TX_INTERRUPT;
}

static void sent_link(void) { stop_tx_interrupt(UART_LINK); }
static void sent_xcp(void) { stop_tx_interrupt(UART_XCP); }

__attribute__((section(".vectors"), used)) static const startup_vector vectors[] = {
    STARTUP_VECTORS,
    [STARTUP_INTERRUPT(IRQ_LINK_RX)] = receive_link,
    [STARTUP_INTERRUPT(IRQ_LINK_TX)] = sent_link,
    [STARTUP_INTERRUPT(IRQ_PLANT_RX)] = receive_plant,
    [STARTUP_INTERRUPT(IRQ_XCP_RX)] = receive_xcp,
    [STARTUP_INTERRUPT(IRQ_XCP_TX)] = sent_xcp,
};

/* Waits until the UART accepts a byte. QEMU accepts it immediately unless the PC does not read. */
static void send_byte(uint32_t uart, uint8_t byte)
{
  while ((UART_STATE(uart) & UART_TX_FULL) != 0U) {
  }
  UART_DATA(uart) = byte;
}

static void receive_from_plant(uint8_t byte)
{
  uint8_t drive[LINK_SIZE_PLANT_DRIVE];
  if (lockstep_receive(&controller, byte, drive)) {
    for (uint16_t i = 0; i < LINK_SIZE_PLANT_DRIVE; ++i) {
      send_byte(UART_PLANT, drive[i]);
    }
    xcp_line_tick(&xcp);
  }
}

static uint16_t link_read(void *context, uint8_t *bytes, uint16_t size)
{
  (void)context;
  uint16_t count = 0;
  while (count < size && from_link.tail != from_link.head) {
    bytes[count++] = from_link.bytes[from_link.tail % RING_BYTES];
    ++from_link.tail;
  }
  return count;
}

/* Sends the bytes that the UART accepts now. The interrupt wakes main for the remaining bytes. */
static uint16_t write_available(uint32_t uart, const uint8_t *bytes, uint16_t count)
{
  uint16_t taken = 0;
  while (taken < count && (UART_STATE(uart) & UART_TX_FULL) == 0U) {
    UART_DATA(uart) = bytes[taken++];
  }
  if (taken < count) {
    UART_CONTROL(uart) |= UART_TX_INTERRUPT_ENABLE;
  }
  return taken;
}

static uint16_t link_write(void *context, const uint8_t *bytes, uint16_t count)
{
  (void)context;
  return write_available(UART_LINK, bytes, count);
}

/* Processes received bytes and sends packets. Call it again while it returns 1. */
static int serve_xcp(void)
{
  uint16_t count = 0;
  int has_moved = 0;
  const uint8_t byte = from_xcp.bytes[from_xcp.tail % RING_BYTES];
  if (from_xcp.tail != from_xcp.head && xcp_line_take(&xcp, &byte, 1) > 0U) {
    ++from_xcp.tail;
    has_moved = 1;
  }
  const uint8_t *packet = xcp_line_offer(&xcp, &count);
  count = write_available(UART_XCP, packet, count);
  xcp_line_sent(&xcp, count);
  return has_moved || count > 0U;
}

/* The plant waits for the drive record. Therefore, there is no current to switch off. */
void board_panic(void) {}

/* Opens a UART. QEMU's multiplexer holds earlier bytes until one byte is read. */
static void open_uart(uint32_t uart)
{
  UART_DIVIDER(uart) = UART_MIN_DIVIDER;
  UART_CONTROL(uart) = UART_TX_ENABLE | UART_RX_ENABLE | UART_RX_INTERRUPT_ENABLE;
  if ((UART_STATE(uart) & UART_RX_FULL) == 0U) {
    (void)UART_DATA(uart);
  }
}

int main(void)
{
  lockstep_start(&controller, link_read, link_write);
  xcp_line_start(&xcp, &controller.firmware, 0);
  open_uart(UART_LINK);
  open_uart(UART_PLANT);
  open_uart(UART_XCP);
  NVIC_ENABLE(IRQ_LINK_RX) = (1U << IRQ_LINK_RX) | (1U << IRQ_LINK_TX) | (1U << IRQ_PLANT_RX) |
                             (1U << IRQ_XCP_RX) | (1U << IRQ_XCP_TX);
  for (;;) {
    app_poll(&controller.firmware);
    while (from_plant.tail != from_plant.head) {
      const uint8_t byte = from_plant.bytes[from_plant.tail % RING_BYTES];
      ++from_plant.tail;
      receive_from_plant(byte);
    }
    while (serve_xcp()) {
    }
    startup_interrupts_off(); /* with interrupts on, a byte could arrive between check and sleep */
    if (from_plant.tail == from_plant.head && from_link.tail == from_link.head &&
        (from_xcp.tail == from_xcp.head || xcp.out_count > 0U)) {
      startup_wait_for_interrupt(); /* a pending interrupt wakes it even while interrupts are off */
    }
    startup_interrupts_on();
  }
}
