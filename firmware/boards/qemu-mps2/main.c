/* SPDX-License-Identifier: Apache-2.0 */
/* Board of the Arm MPS2 (AN385, Cortex-M3) as QEMU models it: UART0 is the link, UART1 the bus of
   the virtual plant, which gives the ticks. Static memory; sleeps while there is nothing to do. */
#include <stdint.h>

#include "lockstep.h"
#include "port/port.h"
#include "startup.h"

/* CMSDK UART: one byte of buffer each way. */
#define UART_LINK 0x40004000U
#define UART_PLANT 0x40005000U
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
#define UART_FASTEST 16U

#define IRQ_LINK_RX 0
#define IRQ_LINK_TX 1
#define IRQ_PLANT_RX 2

#define RING 1024U /* a power of two: indices wrap with it */

/* Filled by an interrupt, emptied by main. */
typedef struct {
  volatile uint16_t head;
  volatile uint16_t tail;
  volatile uint8_t bytes[RING];
} ring;

static ring from_link;
static ring from_plant;

/* Takes what the UART has; what does not fit into the ring is lost, as on any line. */
static void receive(uint32_t uart, ring *to)
{
  UART_INTERRUPT(uart) = UART_RX_INTERRUPT;
  while ((UART_STATE(uart) & UART_RX_FULL) != 0U) {
    const uint8_t byte = (uint8_t)(UART_DATA(uart) & 0xFFU);
    if ((uint16_t)(to->head - to->tail) < RING) {
      to->bytes[to->head % RING] = byte;
      ++to->head;
    }
  }
}

static void receive_link(void) { receive(UART_LINK, &from_link); }
static void receive_plant(void) { receive(UART_PLANT, &from_plant); }

/* Only wakes main, which has more to send. */
static void sent_link(void)
{
  UART_CONTROL(UART_LINK) &= ~UART_TX_INTERRUPT_ENABLE;
  UART_INTERRUPT(UART_LINK) = UART_TX_INTERRUPT;
}

__attribute__((section(".vectors"), used)) static const startup_vector vectors[] = {
    STARTUP_VECTORS,
    [STARTUP_INTERRUPT(IRQ_LINK_RX)] = receive_link,
    [STARTUP_INTERRUPT(IRQ_LINK_TX)] = sent_link,
    [STARTUP_INTERRUPT(IRQ_PLANT_RX)] = receive_plant,
};

/* The line is as long as it needs to be: QEMU takes a byte at once unless the PC does not read. */
static void send(uint32_t uart, uint8_t byte)
{
  while ((UART_STATE(uart) & UART_TX_FULL) != 0U) {
  }
  UART_DATA(uart) = byte;
}

/* Nobody else listens. */
void board_ticked(void) {}

void board_plant_write(const uint8_t *bytes, uint16_t count)
{
  for (uint16_t i = 0; i < count; ++i) {
    send(UART_PLANT, bytes[i]);
  }
}

uint16_t port_link_read(uint8_t *bytes, uint16_t most)
{
  uint16_t count = 0;
  while (count < most && from_link.tail != from_link.head) {
    bytes[count++] = from_link.bytes[from_link.tail % RING];
    ++from_link.tail;
  }
  return count;
}

uint16_t port_link_write(const uint8_t *bytes, uint16_t count)
{
  uint16_t taken = 0;
  while (taken < count && (UART_STATE(UART_LINK) & UART_TX_FULL) == 0U) {
    UART_DATA(UART_LINK) = bytes[taken++];
  }
  if (taken < count) {
    UART_CONTROL(UART_LINK) |= UART_TX_INTERRUPT_ENABLE;
  }
  return taken;
}

/* The plant waits for the drive, so that there is nothing to bring to rest. */
void board_panic(void) {}

static void open_uart(uint32_t uart)
{
  UART_DIVIDER(uart) = UART_FASTEST;
  UART_CONTROL(uart) = UART_TX_ENABLE | UART_RX_ENABLE | UART_RX_INTERRUPT_ENABLE;
}

int main(void)
{
  (void)lockstep_start();
  open_uart(UART_LINK);
  open_uart(UART_PLANT);
  NVIC_ENABLE(IRQ_LINK_RX) = (1U << IRQ_LINK_RX) | (1U << IRQ_LINK_TX) | (1U << IRQ_PLANT_RX);
  for (;;) {
    lockstep_poll();
    while (from_plant.tail != from_plant.head) {
      const uint8_t byte = from_plant.bytes[from_plant.tail % RING];
      ++from_plant.tail;
      lockstep_receive(byte);
    }
    startup_interrupts_off(); /* or a byte could arrive between the question and the sleep */
    if (from_plant.tail == from_plant.head && from_link.tail == from_link.head) {
      startup_wait_for_interrupt(); /* wakes on a pending interrupt, although they are off */
    }
    startup_interrupts_on();
  }
}
