/* SPDX-License-Identifier: Apache-2.0 */
#include "serial.h"

#include "nucleo.h"
#include "registers.h"

#define BAUD 921600U
#define INTERRUPT_PRIORITY 0x80U

#define PORT_ENABLED (USART_CR1_UE | USART_CR1_TE | USART_CR1_RE)

/* Zero-initialised, so that the buffers need no flash. */
serial serial_link;
serial serial_xcp;

uint16_t serial_read(void *context, uint8_t *bytes, uint16_t size)
{
  serial *s = context;
  const uint16_t write_at =
      (uint16_t)((SERIAL_RING_BYTES - DMA_NDTR(s->dma_stream)) % SERIAL_RING_BYTES);
  uint16_t count = 0;
  while (count < size && s->read_index != write_at) {
    bytes[count++] = s->received[s->read_index];
    s->read_index = (uint16_t)((s->read_index + 1U) % SERIAL_RING_BYTES);
  }
  return count;
}

uint16_t serial_write(void *context, const uint8_t *bytes, uint16_t count)
{
  serial *s = context;
  uint16_t taken = 0;
  while (taken < count && (uint16_t)(s->send_head - s->send_tail) < SERIAL_RING_BYTES) {
    s->to_send[s->send_head % SERIAL_RING_BYTES] = bytes[taken++];
    ++s->send_head;
  }
  USART_CR1(s->port_registers) = PORT_ENABLED | USART_CR1_TXEIE;
  return taken;
}

static void send_next_byte(serial *s)
{
  if (s->send_tail == s->send_head) {
    USART_CR1(s->port_registers) = PORT_ENABLED;
    return;
  }
  if ((USART_SR(s->port_registers) & USART_SR_TXE) != 0U) {
    USART_DR(s->port_registers) = s->to_send[s->send_tail % SERIAL_RING_BYTES];
    ++s->send_tail;
  }
}

void serial_link_ready(void) { send_next_byte(&serial_link); }
void serial_xcp_ready(void) { send_next_byte(&serial_xcp); }

/* Starts a port. Both ports receive on channel 4 of their streams. */
static void start_port(serial *s, uint32_t port, uint32_t stream, uint32_t irq)
{
  s->port_registers = port;
  s->dma_stream = stream;
  DMA_PAR(s->dma_stream) = USART_DR_ADDRESS(s->port_registers);
  DMA_M0AR(s->dma_stream) = (uint32_t)(uintptr_t)s->received;
  DMA_NDTR(s->dma_stream) = SERIAL_RING_BYTES;
  DMA_CR(s->dma_stream) = DMA_CR_CHANNEL(4U) | DMA_CR_MINC | DMA_CR_CIRC | DMA_CR_EN;
  USART_BRR(s->port_registers) = (APB1_HZ + BAUD / 2U) / BAUD;
  USART_CR3(s->port_registers) = USART_CR3_DMAR;
  USART_CR1(s->port_registers) = PORT_ENABLED;
  NVIC_PRIORITY(irq) = INTERRUPT_PRIORITY;
  NVIC_ENABLE(irq) = NVIC_BIT(irq);
}

void serial_start(void)
{
  RCC_APB1ENR |= RCC_APB1ENR_USART2 | RCC_APB1ENR_UART4;
  (void)RCC_APB1ENR; /* a peripheral clock runs two cycles after its bit was set */
  GPIOA_AFRL |= GPIO_FUNCTION(7U, 2U) | GPIO_FUNCTION(7U, 3U);
  GPIOA_MODER |= GPIO_ALTERNATE(2U) | GPIO_ALTERNATE(3U);
  GPIOC_AFRH |= GPIO_FUNCTION(8U, 10U) | GPIO_FUNCTION(8U, 11U);
  GPIOC_PUPDR |= GPIO_PULL_UP(11U); /* pull-up: idle level without a cable */
  GPIOC_MODER |= GPIO_ALTERNATE(10U) | GPIO_ALTERNATE(11U);
  start_port(&serial_link, USART2, DMA1_STREAM(5U), USART2_IRQ);
  start_port(&serial_xcp, UART4, DMA1_STREAM(2U), UART4_IRQ);
}
