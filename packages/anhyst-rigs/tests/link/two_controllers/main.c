/* SPDX-License-Identifier: Apache-2.0 */
/* Two controllers on one chip, the Cortex-M3 of an Arm MPS2 (AN385) as QEMU models it.
 *
 * The links are UART0 and UART1. Each controller runs one tick per byte received on its UART. Its
 * answers therefore depend neither on the time of arrival nor on the other controller. The
 * simulated magnet follows the current without delay. */
#include <stdint.h>

#include "lockstep.h"
#include "startup.h"

#define UART(number) (0x40004000U + 0x1000U * (number))
#define UART_DATA(uart) REGISTER((uart) + 0x00U)
#define UART_STATE(uart) REGISTER((uart) + 0x04U)
#define UART_CONTROL(uart) REGISTER((uart) + 0x08U)
#define UART_DIVIDER(uart) REGISTER((uart) + 0x10U)

#define UART_TX_FULL 1U
#define UART_RX_FULL 2U
#define UART_BOTH_ENABLE 3U
#define UART_MIN_DIVIDER 16U

typedef struct {
  app firmware;
  app_body body;
  struct port port;
  uint32_t uart;
  uint32_t tick;
  int32_t flows; /* q30 */
  uint8_t byte;
  uint8_t waits; /* the byte was not read yet */
} controller;

static controller controllers[2];

static void sense(void *context, port_sample *sample)
{
  const controller *c = context;
  const int32_t noise = ((int32_t)(c->tick % 3U) - 1) * 1000;
  sample->tick = c->tick;
  sample->gap = PORT_ONE / 2 + noise;
  sample->force = c->flows / 2 + noise;
  sample->position = 0;
  sample->current[0] = c->flows + noise;
  sample->current[1] = 0;
  sample->status = 0;
}

static void drive(void *context, const int32_t *currents, uint32_t state)
{
  (void)state;
  ((controller *)context)->flows = currents[0] / 2;
}

static uint16_t link_read(void *context, uint8_t *bytes, uint16_t most)
{
  controller *c = context;
  const uint16_t count = c->waits > 0U && most > 0U ? 1U : 0U;
  if (count > 0U) {
    bytes[0] = c->byte;
    c->waits = 0;
  }
  return count;
}

static uint16_t link_write(void *context, const uint8_t *bytes, uint16_t count)
{
  const uint32_t uart = ((const controller *)context)->uart;
  for (uint16_t i = 0; i < count; i++) {
    while ((UART_STATE(uart) & UART_TX_FULL) != 0U) {
    }
    UART_DATA(uart) = bytes[i];
  }
  return count;
}

static void nothing(void *context) { (void)context; }

static int keep(void *context, const int16_t *block, uint16_t words)
{
  (void)context;
  (void)block;
  (void)words;
  return 0;
}

void board_panic(void) {}

__attribute__((section(".vectors"), used)) static const startup_vector vectors[] = {
    STARTUP_VECTORS};

static void start(controller *c, uint32_t uart)
{
  const struct port port = {.context = c,
                            .sense = sense,
                            .drive = drive,
                            .link_read = link_read,
                            .link_write = link_write,
                            .lock = nothing,
                            .unlock = nothing,
                            .keep = keep};
  c->port = port;
  c->uart = uart;
  UART_DIVIDER(uart) = UART_MIN_DIVIDER;
  UART_CONTROL(uart) = UART_BOTH_ENABLE;
  app_start(&c->firmware, &c->body, &lockstep_board, &c->port);
}

static void serve(controller *c)
{
  if ((UART_STATE(c->uart) & UART_RX_FULL) != 0U) {
    c->byte = (uint8_t)(UART_DATA(c->uart) & 0xFFU);
    c->waits = 1;
    c->tick++;
    app_tick(&c->firmware);
    app_poll(&c->firmware);
  }
}

int main(void)
{
  start(&controllers[0], UART(0U));
  start(&controllers[1], UART(1U));
  for (;;) {
    serve(&controllers[0]);
    serve(&controllers[1]);
  }
}
