/* SPDX-License-Identifier: Apache-2.0 */
/* Board ST Nucleo-F446RE (STM32F446RE, Cortex-M4F at 166 MHz), registers only.

   Timer 2 begins a tick: its update starts three converters at the same instant (gap, force,
   current) and puts out the current computed in the tick before, without any instruction, so that
   neither jitters. The end of conversion is the interrupt in which the tick is computed; frames are
   handled in between. Bytes arrive by DMA, since a tick takes longer than a byte.

     PA0 (A0)  gap sensor        PA4 (A2)  current reference, 0 V: no current
     PA1 (A1)  force sensor      PA8 (D7)  power stage on (high)
     PC0 (A5)  current sensor    PA5       LED: run
     PA2, PA3  link, 921600 baud, 8N1, through the USB port of the board's ST-Link

   The sensors' outputs have a live zero, so that a broken wire is no value: 0.33 V is 0, 2.97 V
   is 1.0. docs/boards.md tells the rest. */
#include <stdint.h>

#include "boards/actuator.h"
#include "app/app.h"
#include "nucleo.h"
#include "port/port.h"
#include "registers.h"

#define CRYSTAL_HZ 8000000U /* from the ST-Link, not a crystal: bypass */
#define PLL_M 8U
#define PLL_N 332U /* 8 MHz/8*332/2 = 166 MHz: makes the 921600 baud good to 0.07 % */
#define PLL_Q 7U   /* not used; 2 or more */
#define PLL_R 2U   /* likewise */
#define CORE_HZ (CRYSTAL_HZ / PLL_M * PLL_N / 2U)
#define APB1_HZ (CORE_HZ / 4U)
#define TIMER_HZ (2U * APB1_HZ)
#define BAUD 921600U
/* Of about 8 kHz: 5 ms and four ticks. */
#define WATCHDOG_COUNTS (40U + 32000U / ACTUATOR_RATE_HZ)

#define GAP_ADC 1U
#define FORCE_ADC 2U
#define CURRENT_ADC 3U
#define GAP_CHANNEL 0U
#define FORCE_CHANNEL 1U
#define CURRENT_CHANNEL 10U

#define PIN_LED 5U
#define PIN_STAGE 8U

/* Codes of a sensor: 10 % of 3.3 V is 0, 90 % is 1.0; below and above the others is no value. */
#define CODE_ZERO 410
#define CODE_ONE 3686
#define CODE_LEAST 80
#define CODE_MOST 4015
#define Q30_OF_CODE (PORT_ONE / (CODE_ONE - CODE_ZERO))

#define TICK_PRIORITY 0x10U
#define LINK_PRIORITY 0x80U

#define RING 2048U /* a power of two; 22 ms of the line */

static volatile uint8_t received[RING]; /* written by DMA, round and round */
static uint16_t read_at;

static volatile uint8_t to_send[RING];
static volatile uint16_t send_head; /* only main moves it */
static volatile uint16_t send_tail; /* only the interrupt does */

static uint32_t tick;
static app firmware;

/* A value between 0.33 V and 2.97 V; nothing overflows: |code - zero| <= 3685, times 327760. */
static int32_t value_of_code(uint32_t code)
{
  const int32_t c = (int32_t)(code & 0xFFFU);
  if (c < CODE_LEAST || c > CODE_MOST) {
    return PORT_RESERVED;
  }
  return (c - CODE_ZERO) * Q30_OF_CODE;
}

void port_sense(port_sample *sample)
{
  sample->tick = tick;
  sample->gap = value_of_code(ADC_JDR1(GAP_ADC));
  sample->force = value_of_code(ADC_JDR1(FORCE_ADC));
  sample->position = 0;
  sample->current[0] = value_of_code(ADC_JDR1(CURRENT_ADC));
  sample->current[1] = 0;
  sample->status = 0;
}

static void set_pin(uint32_t pin, int high) { GPIOA_BSRR = high ? 1U << pin : 1U << (pin + 16U); }

/* The converter holds the code back until the next tick begins. */
void port_drive(const int32_t *currents, uint32_t state)
{
  const int32_t current = currents[0];
  const uint32_t now = state & 0xFFU;
  DAC_DHR12R1 = current > 0 ? (uint32_t)current >> 19 : 0U;
  set_pin(PIN_STAGE, current != 0 || now == ANHYST_STATE_READY || now == ANHYST_STATE_RUN);
  set_pin(PIN_LED, now == ANHYST_STATE_RUN);
  IWDG_KR = IWDG_KR_FEED;
}

/* The pin of the converter goes to 0 V at once: without its trigger, the code is taken over. */
void board_panic(void)
{
  set_pin(PIN_STAGE, 0);
  DAC_CR = DAC_CR_EN1;
  DAC_DHR12R1 = 0;
}

uint16_t port_link_read(uint8_t *bytes, uint16_t most)
{
  const uint16_t write_at = (uint16_t)((RING - DMA1_S5NDTR) % RING);
  uint16_t count = 0;
  while (count < most && read_at != write_at) {
    bytes[count++] = received[read_at];
    read_at = (uint16_t)((read_at + 1U) % RING);
  }
  return count;
}

uint16_t port_link_write(const uint8_t *bytes, uint16_t count)
{
  uint16_t taken = 0;
  while (taken < count && (uint16_t)(send_head - send_tail) < RING) {
    to_send[send_head % RING] = bytes[taken++];
    ++send_head;
  }
  USART2_CR1 = USART2_CR1_UE | USART2_CR1_TE | USART2_CR1_RE | USART2_CR1_TXEIE;
  return taken;
}

void port_lock(void) { startup_interrupts_off(); }
void port_unlock(void) { startup_interrupts_on(); }

/* The three values are there: computes the tick. One that began meanwhile is missed: what it
   converted is left alone, and the number of the next sample tells. */
static void converted(void)
{
  const uint32_t none = ~ADC_SR_JEOC;
  ADC_SR(GAP_ADC) = none;
  tick = TIM5_CNT;
  app_tick(&firmware);
  if (TIM5_CNT != tick) {
    ADC_SR(GAP_ADC) = none;
    NVIC_CLEAR_PENDING(ADC_IRQ) = NVIC_BIT(ADC_IRQ);
  }
}

static void send_next(void)
{
  if (send_tail == send_head) {
    USART2_CR1 = USART2_CR1_UE | USART2_CR1_TE | USART2_CR1_RE;
    return;
  }
  if ((USART2_SR & USART2_SR_TXE) != 0U) {
    USART2_DR = to_send[send_tail % RING];
    ++send_tail;
  }
}

__attribute__((section(".vectors"), used)) static const startup_vector vectors[] = {
    STARTUP_VECTORS,
    [STARTUP_INTERRUPT(ADC_IRQ)] = converted,
    [STARTUP_INTERRUPT(USART2_IRQ)] = send_next,
};

/* Without the ST-Link's clock nothing here would be on time: then it waits here, current off. */
static void start_clocks(void)
{
  RCC_CR |= RCC_CR_HSEBYP;
  RCC_CR |= RCC_CR_HSEON;
  while ((RCC_CR & RCC_CR_HSERDY) == 0U) {
  }
  RCC_PLLCFGR = PLL_M | (PLL_N << 6) | RCC_PLLCFGR_SRC_HSE | (PLL_Q << 24) | (PLL_R << 28);
  RCC_CR |= RCC_CR_PLLON;
  while ((RCC_CR & RCC_CR_PLLRDY) == 0U) {
  }
  FLASH_ACR = FLASH_ACR_LATENCY_5 | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
  RCC_CFGR = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2 | RCC_CFGR_SW_PLL;
  while ((RCC_CFGR & RCC_CFGR_SWS) != RCC_CFGR_SWS_PLL) {
  }
  RCC_AHB1ENR |= RCC_AHB1ENR_GPIOA | RCC_AHB1ENR_GPIOC | RCC_AHB1ENR_DMA1;
  RCC_APB1ENR |= RCC_APB1ENR_TIM2 | RCC_APB1ENR_TIM5 | RCC_APB1ENR_USART2 | RCC_APB1ENR_DAC;
  RCC_APB2ENR |= RCC_APB2ENR_ADC123;
  (void)RCC_APB2ENR; /* a clock runs two cycles after its bit was set */
}

static void start_pins(void)
{
  GPIOA_AFRL |= (7U << 8) | (7U << 12);
  GPIOA_MODER |= GPIO_ANALOG(0U) | GPIO_ANALOG(1U) | GPIO_ALTERNATE(2U) | GPIO_ALTERNATE(3U) |
                 GPIO_ANALOG(4U) | GPIO_OUTPUT(PIN_LED) | GPIO_OUTPUT(PIN_STAGE);
  GPIOC_MODER |= GPIO_ANALOG(0U);
}

static void start_link(void)
{
  DMA1_S5PAR = USART2_DR_ADDRESS;
  DMA1_S5M0AR = (uint32_t)(uintptr_t)received;
  DMA1_S5NDTR = RING;
  DMA1_S5CR = DMA1_S5CR_CHANNEL_4 | DMA1_S5CR_MINC | DMA1_S5CR_CIRC | DMA1_S5CR_EN;
  USART2_BRR = (APB1_HZ + BAUD / 2U) / BAUD;
  USART2_CR3 = USART2_CR3_DMAR;
  USART2_CR1 = USART2_CR1_UE | USART2_CR1_TE | USART2_CR1_RE;
  NVIC_PRIORITY(USART2_IRQ) = LINK_PRIORITY;
  NVIC_ENABLE(USART2_IRQ) = NVIC_BIT(USART2_IRQ);
}

static void start_converter(uint32_t adc, uint32_t channel)
{
  if (channel < 10U) {
    ADC_SMPR2(adc) = ADC_SMP_56_CYCLES(channel);
  } else {
    ADC_SMPR1(adc) = ADC_SMP_56_CYCLES(channel);
  }
  ADC_JSQR(adc) = ADC_JSQR_ONE(channel);
  ADC_CR2(adc) = ADC_CR2_ADON;
}

static void start_ticks(void)
{
  ADC_CCR = ADC_CCR_ADCPRE_4 | ADC_CCR_MULTI_TRIPLE_INJECTED;
  start_converter(FORCE_ADC, FORCE_CHANNEL);
  start_converter(CURRENT_ADC, CURRENT_CHANNEL);
  start_converter(GAP_ADC, GAP_CHANNEL); /* the first of the three starts the others */
  ADC_CR1(GAP_ADC) = ADC_CR1_JEOCIE;
  ADC_CR2(GAP_ADC) = ADC_CR2_ADON | ADC_CR2_JEXTSEL_TIM2_TRGO | ADC_CR2_JEXTEN_RISING;
  DAC_DHR12R1 = 0;
  DAC_CR = DAC_CR_TSEL1_TIM2 | DAC_CR_TEN1 | DAC_CR_EN1;
  NVIC_PRIORITY(ADC_IRQ) = TICK_PRIORITY;
  NVIC_ENABLE(ADC_IRQ) = NVIC_BIT(ADC_IRQ);
  TIM5_SMCR = TIM5_SMCR_COUNT_TIM2;
  TIM5_CR1 = TIM5_CR1_CEN;
  TIM2_PSC = 0;
  TIM2_ARR = TIMER_HZ / ACTUATOR_RATE_HZ - 1U;
  TIM2_CR2 = TIM2_CR2_MMS_UPDATE;
  TIM2_CR1 = TIM2_CR1_CEN;
}

static void start_watchdog(void)
{
  IWDG_KR = IWDG_KR_START;
  IWDG_KR = IWDG_KR_UNLOCK;
  IWDG_PR = IWDG_PR_4;
  IWDG_RLR = WATCHDOG_COUNTS;
}

int main(void)
{
  SCB_CPACR |= 0xFU << 20; /* a compensator in f32 needs the floating-point unit */
  start_clocks();
  start_pins();
  app_start(&firmware, &nucleo_board);
  start_link();
  start_watchdog();
  start_ticks();
  for (;;) {
    app_poll(&firmware);
  }
}
