/* SPDX-License-Identifier: Apache-2.0 */
#include "place.h"

#include "nucleo.h"
#include "registers.h"

/* The word that SPI sends while it reads the ADC; the ADC ignores it. */
static const uint16_t dummy_word = 0;

static uint16_t last_count;
static uint32_t edges;

/* DMA stream that sends words to the ADC. */
#define ADC_DMA_STREAM DMA1_STREAM(1U)

/* Starts encoder and ADC. Channel 3 of timer 2 is high from the tick to the end of the conversion.
   Then DMA sends a word, and the SPI receives the code at the same time. */
void position_input_start(void)
{
  GPIOB_AFRL |= GPIO_FUNCTION(2U, 6U) | GPIO_FUNCTION(2U, 7U);
  GPIOB_PUPDR |= GPIO_PULL_UP(6U) | GPIO_PULL_UP(7U);
  GPIOB_MODER |= GPIO_ALTERNATE(6U) | GPIO_ALTERNATE(7U);
  TIM4_ARR = 0xFFFFU;
  TIM4_CCMR1 = TIM4_CCMR1_FILTERED;
  TIM4_SMCR = TIM4_SMCR_ENCODER;
  TIM4_CR1 = TIM4_CR1_CEN;
  GPIOB_AFRH |= GPIO_FUNCTION(1U, 10U) | GPIO_FUNCTION(5U, 13U);
  GPIOC_AFRL |= GPIO_FUNCTION(5U, 2U);
  SPI2_CR2 = 0;
  SPI2_CR1 = SPI_CR1_DFF | SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_MSTR | SPI_CR1_SPE;
  DMA_PAR(ADC_DMA_STREAM) = SPI2_DR_ADDRESS;
  DMA_M0AR(ADC_DMA_STREAM) = (uint32_t)(uintptr_t)&dummy_word;
  DMA_NDTR(ADC_DMA_STREAM) = 1;
  DMA_CR(ADC_DMA_STREAM) =
      DMA_CR_CHANNEL(3U) | DMA_CR_HALF_WORDS | DMA_CR_CIRC | DMA_CR_TO_PERIPHERAL | DMA_CR_EN;
  TIM2_CCR3 = TIMER_HZ / 1000000U * POSITION_CONVERSION_NS / 1000U;
  TIM2_CCMR2 = TIM2_CCMR2_3_PULSES;
  TIM2_CCER = TIM2_CCER_CC3E;
  TIM2_DIER = TIM2_DIER_CC3DE;
  GPIOB_MODER |= GPIO_ALTERNATE(10U) | GPIO_ALTERNATE(13U);
  GPIOC_MODER |= GPIO_ALTERNATE(2U);
}

int32_t read_encoder_position(void)
{
  const uint16_t count = (uint16_t)TIM4_CNT;
  const uint16_t step = (uint16_t)(count - last_count);
  edges += step < 0x8000U ? step : step - 0x10000U;
  last_count = count;
  return edges <= 0x7FFFFFFFU ? (int32_t)edges : -(int32_t)(0xFFFFFFFFU - edges) - 1;
}

int32_t read_converter_position(void)
{
  int32_t code = -1;
  if ((SPI2_SR & SPI_SR_RXNE) != 0U) {
    code = (int32_t)(SPI2_DR & 0xFFFFU); /* reading the register clears the flag */
  }
  return code;
}
