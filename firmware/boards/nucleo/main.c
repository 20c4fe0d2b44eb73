/* SPDX-License-Identifier: Apache-2.0 */
/* Board ST Nucleo-F446RE (STM32F446RE, Cortex-M4F at 166 MHz), registers only.

   Timer 2 starts a tick. The update of the timer starts three ADCs at the same instant (gap, force,
   current) and outputs the current of the last tick, both in hardware, so that neither jitters. The
   end-of-conversion interrupt computes the tick. The main loop handles frames between ticks.

       PA0 (A0)  gap sensor        PA4 (A2)  current reference, 0 V: no current
       PA1 (A1)  force sensor; of a position controller, the second current sensor
       PC0 (A5)  current sensor    PA5       LED: run

   Other pins: stage.h (power stage, pulse references, fault inputs), place.h (position), serial.h
   (lines to a PC). The sensors have a live zero, so that a broken wire gives no valid value: 0.33 V
   is 0 and 2.97 V is 1.0, unless the set in flash differs. See docs/boards.md. */
#include <stddef.h>
#include <stdint.h>

#include BOARD_BODY /* force/force.h or position/position.h */
#include "boards/actuator.h"
#include "app/app.h"
#include "memory.h"
#include "nucleo.h"
#include "place.h"
#include "registers.h"
#include "serial.h"
#include "services/thermal.h"
#include "stage.h"
#include "xcp/line.h"

/* Watchdog time: 5 ms plus four ticks, in counts of about 8 kHz. */
#define WATCHDOG_COUNTS (40U + 32000U / ACTUATOR_RATE_HZ)

#define GAP_ADC 1U
#define FORCE_ADC 2U
#define CURRENT_ADC 3U
#define GAP_CHANNEL 0U
#define FORCE_CHANNEL 1U
#define CURRENT_CHANNEL 10U

#define PIN_LED 5U

/* Sensor codes: 10 % of 3.3 V is 0, 90 % is 1.0. Codes outside MIN_CODE..MAX_CODE have no value. */
#define ZERO_CODE 410
#define FULL_SCALE_CODE 3686
#define MIN_CODE 80
#define MAX_CODE 4015
#define Q30_OF_CODE (PORT_ONE / (FULL_SCALE_CODE - ZERO_CODE))
#define LIVE_ZERO {ZERO_CODE, Q30_OF_CODE, 0, MIN_CODE, MAX_CODE}

/* Winding: time constant (s), and the currents at which the protection trips and clears (q30). */
#define WINDING_TIME_CONSTANT_S 60U
#define WINDING_TRIP_CURRENT (PORT_ONE / 10 * 7)
#define WINDING_CLEAR_CURRENT (PORT_ONE / 2)

#define TICK_PRIORITY 0x10U

static uint32_t tick;
static app firmware;
static app_body body;
static xcp_line xcp;

/* Default until a set is stored: one encoder code is 2^-16 of the full-scale position. */
static memory_set stored_set = {
    .layout = MEMORY_LAYOUT,
    .gap = LIVE_ZERO,
    .force = LIVE_ZERO,
    .current = LIVE_ZERO,
    .position = {0, 32768, 0, -65535, 65535},
    .position_source = POSITION_FROM_ENCODER,
};

static app_board active_board;
static thermal_plan winding_plan;
static thermal windings[PORT_CURRENTS];

static void sense_position(port_sample *sample)
{
  int32_t code = read_encoder_position(); /* read in every tick; otherwise edges are lost */
  if (stored_set.position_source == POSITION_FROM_CONVERTER) {
    code = read_converter_position();
    if (code < 0) {
      sample->status |= PORT_NO_SAMPLE;
    }
  }
  sample->position = calibration_value(&stored_set.position, code);
}

static int32_t read_adc(uint32_t adc) { return (int32_t)(ADC_JDR1(adc) & 0xFFFU); }

static void sense(void *context, port_sample *sample)
{
  (void)context;
  sample->tick = tick;
  sample->status = power_stage_status();
  sample->gap = calibration_value(&stored_set.gap, read_adc(GAP_ADC));
  sample->force = calibration_value(&stored_set.force, read_adc(FORCE_ADC));
  sample->current[0] = calibration_value(&stored_set.current, read_adc(CURRENT_ADC));
  sample->current[1] =
      nucleo_board.plan != NULL ? calibration_value(&stored_set.current, read_adc(FORCE_ADC)) : 0;
  sense_position(sample);
  for (uint16_t i = 0; i < PORT_CURRENTS; i++) {
    if (thermal_tick(&windings[i], &winding_plan, sample->current[i])) {
      sample->status |= PORT_TOO_WARM;
    }
  }
}

/* The DAC outputs this code when the next tick begins. */
static void drive(void *context, const int32_t *currents, uint32_t state)
{
  (void)context;
  const int32_t current = currents[0];
  const uint32_t now = state & 0xFFU;
  DAC_DHR12R1 = current > 0 ? (uint32_t)current >> 19 : 0U;
  power_stage_drive(currents, current != 0 || currents[1] != 0 || now == ANHYST_STATE_READY ||
                                  now == ANHYST_STATE_RUN);
  GPIOA_BSRR = now == ANHYST_STATE_RUN ? 1U << PIN_LED : 1U << (PIN_LED + 16U);
  IWDG_KR = IWDG_KR_FEED;
}

/* Without its trigger the DAC outputs the code immediately: 0 V. */
void board_panic(void)
{
  stage_panic();
  DAC_CR = DAC_CR_EN1;
  DAC_DHR12R1 = 0;
}

static void lock(void *context)
{
  (void)context;
  startup_interrupts_off();
}

static void unlock(void *context)
{
  (void)context;
  startup_interrupts_on();
}

/* Restores the tick counter, so that the time of the erase counts as no tick. */
static int store_block(void *context, const int16_t *block, uint16_t words)
{
  (void)context;
  startup_interrupts_off();
  stored_set.words = words;
  for (uint16_t i = 0; i < words; i++) {
    stored_set.block[i] = block[i];
  }
  const int is_stored = memory_save(&stored_set);
  TIM5_CNT = tick;
  ADC_SR(GAP_ADC) = ~ADC_SR_JEOC;
  NVIC_CLEAR_PENDING(ADC_IRQ) = NVIC_BIT(ADC_IRQ);
  startup_interrupts_on();
  return is_stored;
}

static const struct port port = {.context = &serial_link,
                                 .sense = sense,
                                 .drive = drive,
                                 .link_read = serial_read,
                                 .link_write = serial_write,
                                 .lock = lock,
                                 .unlock = unlock,
                                 .keep = store_block};

/* Computes the tick after the three conversions. If another tick began meanwhile, that tick is
   missed: its conversion is ignored, and the tick number of the next sample shows it. */
static void on_conversion_done(void)
{
  const uint32_t cleared_flags = ~ADC_SR_JEOC;
  const uint32_t start_cycles = DWT_CYCCNT;
  ADC_SR(GAP_ADC) = cleared_flags;
  tick = TIM5_CNT;
  app_tick(&firmware);
  xcp_line_tick(&xcp);
  const uint32_t cycles = DWT_CYCCNT - start_cycles;
  if (cycles > firmware.max_tick_cycles) {
    firmware.max_tick_cycles = cycles;
  }
  if (TIM5_CNT != tick) {
    ADC_SR(GAP_ADC) = cleared_flags;
    NVIC_CLEAR_PENDING(ADC_IRQ) = NVIC_BIT(ADC_IRQ);
  }
}

/* Sends a waiting packet, or processes one received byte. */
static void poll_xcp(void)
{
  uint8_t byte = 0;
  uint16_t count = 0;
  const uint8_t *packet = xcp_line_offer(&xcp, &count);
  if (count > 0U) {
    xcp_line_sent(&xcp, serial_write(&serial_xcp, packet, count));
  } else if (serial_read(&serial_xcp, &byte, 1) > 0U) {
    (void)xcp_line_take(&xcp, &byte, 1);
  }
}

__attribute__((section(".vectors"), used)) static const startup_vector vectors[] = {
    STARTUP_VECTORS,
    [STARTUP_INTERRUPT(ADC_IRQ)] = on_conversion_done,
    [STARTUP_INTERRUPT(USART2_IRQ)] = serial_link_ready,
    [STARTUP_INTERRUPT(UART4_IRQ)] = serial_xcp_ready,
};

/* Starts the clocks. Waits forever, current off, if the clock from the ST-Link is missing. */
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
  RCC_AHB1ENR |= RCC_AHB1ENR_GPIOA | RCC_AHB1ENR_GPIOB | RCC_AHB1ENR_GPIOC | RCC_AHB1ENR_DMA1;
  RCC_APB1ENR |=
      RCC_APB1ENR_TIM2 | RCC_APB1ENR_TIM4 | RCC_APB1ENR_TIM5 | RCC_APB1ENR_SPI2 | RCC_APB1ENR_DAC;
  RCC_APB2ENR |= RCC_APB2ENR_TIM1 | RCC_APB2ENR_ADC123;
  (void)RCC_APB2ENR; /* a peripheral clock runs two cycles after its bit was set */
}

static void start_pins(void)
{
  GPIOA_MODER |= GPIO_ANALOG(0U) | GPIO_ANALOG(1U) | GPIO_ANALOG(4U) | GPIO_OUTPUT(PIN_LED);
  GPIOC_MODER |= GPIO_ANALOG(0U);
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
  start_converter(GAP_ADC, GAP_CHANNEL); /* the first ADC starts the other two */
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

/* Starts the app. A stored block replaces the built-in block if kernel and units fit. */
static void start_app(void)
{
  active_board = nucleo_board;
  if (memory_load(&stored_set) && stored_set.words > 0U &&
      anhyst_block_check(nucleo_board.kernel, stored_set.block, (uint16_t)stored_set.words) ==
          ANHYST_OK &&
      anhyst_block_misfit(stored_set.block, nucleo_board.scales) == 0U) {
    active_board.words = stored_set.block;
    active_board.words_capacity = (uint16_t)stored_set.words;
  }
  app_start(&firmware, &body, &active_board, &port);
  xcp_line_start(&xcp, &firmware, 1);
}

static void start_services(void)
{
  DEMCR |= DEMCR_TRCENA;
  DWT_CTRL |= DWT_CTRL_CYCCNTENA;
  (void)thermal_prepare(&winding_plan, WINDING_TIME_CONSTANT_S * ACTUATOR_RATE_HZ,
                        WINDING_TRIP_CURRENT, WINDING_CLEAR_CURRENT);
  for (uint16_t i = 0; i < PORT_CURRENTS; i++) {
    thermal_start(&windings[i], &winding_plan);
  }
}

int main(void)
{
  SCB_CPACR |= 0xFU << 20; /* a compensator in single precision needs the FPU */
  start_clocks();
  start_pins();
  start_services();
  start_app();
  power_stage_start();
  position_input_start();
  serial_start();
  start_watchdog();
  start_ticks();
  for (;;) {
    app_poll(&firmware);
    poll_xcp();
  }
}
