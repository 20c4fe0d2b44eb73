/* SPDX-License-Identifier: Apache-2.0 */
#include "stage.h"

#include "port/port.h"
#include "registers.h"

#define PIN_STOP 4U
#define PIN_AMPLIFIER 5U
#define PIN_OVER_CURRENT 12U
#define PULSE_COUNTS 4096U /* counts per pulse: 12 bits, like the analogue reference */

void power_stage_start(void)
{
  GPIOB_PUPDR |=
      GPIO_PULL_DOWN(PIN_STOP) | GPIO_PULL_DOWN(PIN_AMPLIFIER) | GPIO_PULL_DOWN(PIN_OVER_CURRENT);
  /* After reset, pin 4 belongs to the debug port, with a pull-up. */
  GPIOB_PUPDR &= ~GPIO_PULL_UP(PIN_STOP);
  GPIOB_MODER = (GPIOB_MODER & ~GPIO_MODE(PIN_STOP)) | GPIO_ALTERNATE(PIN_OVER_CURRENT);
  GPIOB_AFRH |= GPIO_FUNCTION(1U, PIN_OVER_CURRENT);
  GPIOA_AFRH |= GPIO_FUNCTION(1U, 8U) | GPIO_FUNCTION(1U, 9U) | GPIO_FUNCTION(1U, 10U);
  TIM1_ARR = PULSE_COUNTS - 1U;
  TIM1_CCMR1 = TIM1_CCMR1_1_LOW | TIM1_CCMR1_2_PULSES;
  TIM1_CCMR2 = TIM1_CCMR2_3_PULSES;
  TIM1_CCER = TIM1_CCER_CC1E | TIM1_CCER_CC2E | TIM1_CCER_CC3E;
  TIM1_BDTR = TIM1_BDTR_BKE | TIM1_BDTR_OSSI;
  TIM1_CR1 = TIM1_CR1_ARPE | TIM1_CR1_CEN;
  GPIOA_MODER |= GPIO_ALTERNATE(8U) | GPIO_ALTERNATE(9U) | GPIO_ALTERNATE(10U);
}

/* Returns the duty cycle in counts; at most PULSE_COUNTS - 1, so that the output never stays high.
 */
static uint32_t duty_cycle(int32_t current) { return current > 0 ? (uint32_t)current >> 19 : 0U; }

static int is_high(uint32_t pin) { return (GPIOB_IDR & (1U << pin)) != 0U; }

void power_stage_drive(const int32_t *currents, int on)
{
  TIM1_CCR2 = duty_cycle(currents[0]);
  TIM1_CCR3 = duty_cycle(currents[1]);
  TIM1_CCMR1 = (on ? TIM1_CCMR1_1_HIGH : TIM1_CCMR1_1_LOW) | TIM1_CCMR1_2_PULSES;
  if (currents[0] == 0 && currents[1] == 0 && is_high(PIN_OVER_CURRENT)) {
    TIM1_SR = ~TIM1_SR_BIF;
    TIM1_BDTR = TIM1_BDTR_BKE | TIM1_BDTR_OSSI | TIM1_BDTR_MOE;
  }
}

uint32_t power_stage_status(void)
{
  uint32_t status = 0;
  if (!is_high(PIN_STOP)) {
    status |= PORT_EMERGENCY_STOP;
  }
  if (!is_high(PIN_AMPLIFIER)) {
    status |= PORT_AMPLIFIER;
  }
  if (!is_high(PIN_OVER_CURRENT) || (TIM1_SR & TIM1_SR_BIF) != 0U) {
    status |= PORT_OVER_CURRENT;
  }
  return status;
}

void stage_panic(void) { TIM1_BDTR = TIM1_BDTR_OSSI; }
