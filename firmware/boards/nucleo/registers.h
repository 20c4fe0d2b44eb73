/* SPDX-License-Identifier: Apache-2.0 */
/* Registers of the STM32F446 that this board uses, named as in the reference manual (RM0390). */
#ifndef REGISTERS_H
#define REGISTERS_H

#include "startup.h"

/* Reset and clock control. */
#define RCC_CR REGISTER(0x40023800U)
#define RCC_CR_HSEON (1U << 16)
#define RCC_CR_HSERDY (1U << 17)
#define RCC_CR_HSEBYP (1U << 18)
#define RCC_CR_PLLON (1U << 24)
#define RCC_CR_PLLRDY (1U << 25)
#define RCC_PLLCFGR REGISTER(0x40023804U)
#define RCC_PLLCFGR_SRC_HSE (1U << 22)
#define RCC_CFGR REGISTER(0x40023808U)
#define RCC_CFGR_SW_PLL 2U
#define RCC_CFGR_SWS (3U << 2)
#define RCC_CFGR_SWS_PLL (2U << 2)
#define RCC_CFGR_PPRE1_4 (5U << 10)
#define RCC_CFGR_PPRE2_2 (4U << 13)
#define RCC_AHB1ENR REGISTER(0x40023830U)
#define RCC_AHB1ENR_GPIOA (1U << 0)
#define RCC_AHB1ENR_GPIOB (1U << 1)
#define RCC_AHB1ENR_GPIOC (1U << 2)
#define RCC_AHB1ENR_DMA1 (1U << 21)
#define RCC_APB1ENR REGISTER(0x40023840U)
#define RCC_APB1ENR_TIM2 (1U << 0)
#define RCC_APB1ENR_TIM4 (1U << 2)
#define RCC_APB1ENR_TIM5 (1U << 3)
#define RCC_APB1ENR_SPI2 (1U << 14)
#define RCC_APB1ENR_USART2 (1U << 17)
#define RCC_APB1ENR_UART4 (1U << 19)
#define RCC_APB1ENR_DAC (1U << 29)
#define RCC_APB2ENR REGISTER(0x40023844U)
#define RCC_APB2ENR_TIM1 (1U << 0)
#define RCC_APB2ENR_ADC123 (7U << 8)

#define FLASH_ACR REGISTER(0x40023C00U)
#define FLASH_ACR_LATENCY_5 5U
#define FLASH_ACR_PRFTEN (1U << 8)
#define FLASH_ACR_ICEN (1U << 9)
#define FLASH_ACR_DCEN (1U << 10)
#define FLASH_ACR_ICRST (1U << 11)
#define FLASH_ACR_DCRST (1U << 12)
#define FLASH_KEYR REGISTER(0x40023C04U)
#define FLASH_KEY_1 0x45670123U
#define FLASH_KEY_2 0xCDEF89ABU
#define FLASH_SR REGISTER(0x40023C0CU)
#define FLASH_SR_ERRORS 0x1F2U /* bits that are cleared by writing ones */
#define FLASH_SR_BSY (1U << 16)
#define FLASH_CR REGISTER(0x40023C10U)
#define FLASH_CR_PG (1U << 0)
#define FLASH_CR_SER (1U << 1)
#define FLASH_CR_SNB(sector) ((uint32_t)(sector) << 3)
#define FLASH_CR_PSIZE_32 (2U << 8)
#define FLASH_CR_STRT (1U << 16)
#define FLASH_CR_LOCK (1U << 31)

/* Pins. */
#define GPIOA_MODER REGISTER(0x40020000U)
#define GPIOA_AFRL REGISTER(0x40020020U)
#define GPIOA_AFRH REGISTER(0x40020024U)
#define GPIOA_BSRR REGISTER(0x40020018U)
#define GPIOB_MODER REGISTER(0x40020400U)
#define GPIOB_PUPDR REGISTER(0x4002040CU)
#define GPIOB_IDR REGISTER(0x40020410U)
#define GPIOB_AFRL REGISTER(0x40020420U)
#define GPIOB_AFRH REGISTER(0x40020424U)
#define GPIOC_MODER REGISTER(0x40020800U)
#define GPIOC_PUPDR REGISTER(0x4002080CU)
#define GPIOC_AFRL REGISTER(0x40020820U)
#define GPIOC_AFRH REGISTER(0x40020824U)
#define GPIO_MODE(pin) (3U << (2U * (pin)))
#define GPIO_PULL_UP(pin) (1U << (2U * (pin)))
#define GPIO_PULL_DOWN(pin) (2U << (2U * (pin)))
#define GPIO_FUNCTION(number, pin) ((uint32_t)(number) << (4U * ((pin) % 8U)))
#define GPIO_OUTPUT(pin) (1U << (2U * (pin)))
#define GPIO_ALTERNATE(pin) (2U << (2U * (pin)))
#define GPIO_ANALOG(pin) (3U << (2U * (pin)))

/* Timer 1: power stage, references and break. */
#define TIM1_CR1 REGISTER(0x40010000U)
#define TIM1_CR1_CEN (1U << 0)
#define TIM1_CR1_ARPE (1U << 7)
#define TIM1_SR REGISTER(0x40010010U)
#define TIM1_SR_BIF (1U << 7)
#define TIM1_CCMR1 REGISTER(0x40010018U)
#define TIM1_CCMR1_1_LOW (4U << 4)
#define TIM1_CCMR1_1_HIGH (5U << 4)
#define TIM1_CCMR1_2_PULSES ((6U << 12) | (1U << 11)) /* preloaded: used from the next pulse */
#define TIM1_CCMR2 REGISTER(0x4001001CU)
#define TIM1_CCMR2_3_PULSES ((6U << 4) | (1U << 3))
#define TIM1_CCER REGISTER(0x40010020U)
#define TIM1_CCER_CC1E (1U << 0)
#define TIM1_CCER_CC2E (1U << 4)
#define TIM1_CCER_CC3E (1U << 8)
#define TIM1_ARR REGISTER(0x4001002CU)
#define TIM1_CCR2 REGISTER(0x40010038U)
#define TIM1_CCR3 REGISTER(0x4001003CU)
#define TIM1_BDTR REGISTER(0x40010044U)
#define TIM1_BDTR_OSSI (1U << 10) /* the outputs are low, not floating, after a break */
#define TIM1_BDTR_BKE (1U << 12)  /* enables a break by a low input */
#define TIM1_BDTR_MOE (1U << 15)

/* Timer 2: the tick; channel 3 starts the 16-bit ADC. */
#define TIM2_CR1 REGISTER(0x40000000U)
#define TIM2_CR1_CEN 1U
#define TIM2_CR2 REGISTER(0x40000004U)
#define TIM2_CR2_MMS_UPDATE (2U << 4)
#define TIM2_DIER REGISTER(0x4000000CU)
#define TIM2_DIER_CC3DE (1U << 11)
#define TIM2_CCMR2 REGISTER(0x4000001CU)
#define TIM2_CCMR2_3_PULSES (6U << 4)
#define TIM2_CCER REGISTER(0x40000020U)
#define TIM2_CCER_CC3E (1U << 8)
#define TIM2_CCR3 REGISTER(0x4000003CU)
#define TIM2_PSC REGISTER(0x40000028U)
#define TIM2_ARR REGISTER(0x4000002CU)

/* Timer 4: the encoder. */
#define TIM4_CR1 REGISTER(0x40000800U)
#define TIM4_CR1_CEN 1U
#define TIM4_SMCR REGISTER(0x40000808U)
#define TIM4_SMCR_ENCODER 3U /* counts every edge of both lines */
#define TIM4_CCMR1 REGISTER(0x40000818U)
#define TIM4_CCMR1_FILTERED 0x3131U /* direct inputs; 8 equal samples count as an edge */
#define TIM4_CNT REGISTER(0x40000824U)
#define TIM4_ARR REGISTER(0x4000082CU)

/* Timer 5: counts the updates of timer 2. */
#define TIM5_CR1 REGISTER(0x40000C00U)
#define TIM5_CR1_CEN 1U
#define TIM5_SMCR REGISTER(0x40000C08U)
#define TIM5_SMCR_COUNT_TIM2 7U /* external clock, internal trigger 0 */
#define TIM5_CNT REGISTER(0x40000C24U)

/* ADCs 1, 2 and 3, 0x100 apart. */
#define ADC_SR(n) REGISTER(0x40012000U + 0x100U * ((n) - 1U))
#define ADC_SR_JEOC (1U << 2)
#define ADC_CR1(n) REGISTER(0x40012004U + 0x100U * ((n) - 1U))
#define ADC_CR1_JEOCIE (1U << 7)
#define ADC_CR2(n) REGISTER(0x40012008U + 0x100U * ((n) - 1U))
#define ADC_CR2_ADON 1U
#define ADC_CR2_JEXTSEL_TIM2_TRGO (3U << 16)
#define ADC_CR2_JEXTEN_RISING (1U << 20)
#define ADC_SMPR1(n) REGISTER(0x4001200CU + 0x100U * ((n) - 1U))
#define ADC_SMPR2(n) REGISTER(0x40012010U + 0x100U * ((n) - 1U))
#define ADC_SMP_56_CYCLES(channel) (3U << (3U * ((channel) % 10U)))
#define ADC_JSQR(n) REGISTER(0x40012038U + 0x100U * ((n) - 1U))
#define ADC_JSQR_ONE(channel) ((uint32_t)(channel) << 15)
#define ADC_JDR1(n) REGISTER(0x4001203CU + 0x100U * ((n) - 1U))
#define ADC_CCR REGISTER(0x40012304U)
#define ADC_CCR_MULTI_TRIPLE_INJECTED 0x15U
#define ADC_CCR_ADCPRE_4 (1U << 16)
#define ADC_IRQ 18U

/* Digital-analogue converter, channel 1. */
#define DAC_CR REGISTER(0x40007400U)
#define DAC_CR_EN1 1U
#define DAC_CR_TEN1 (1U << 2)
#define DAC_CR_TSEL1_TIM2 (4U << 3)
#define DAC_DHR12R1 REGISTER(0x40007408U)

/* Serial ports. */
#define USART2 0x40004400U
#define UART4 0x40004C00U
#define USART_SR(port) REGISTER((port) + 0x00U)
#define USART_SR_TXE (1U << 7)
#define USART_DR_ADDRESS(port) ((port) + 0x04U)
#define USART_DR(port) REGISTER(USART_DR_ADDRESS(port))
#define USART_BRR(port) REGISTER((port) + 0x08U)
#define USART_CR1(port) REGISTER((port) + 0x0CU)
#define USART_CR1_RE (1U << 2)
#define USART_CR1_TE (1U << 3)
#define USART_CR1_TXEIE (1U << 7)
#define USART_CR1_UE (1U << 13)
#define USART_CR3(port) REGISTER((port) + 0x14U)
#define USART_CR3_DMAR (1U << 6)
#define USART2_IRQ 38U
#define UART4_IRQ 52U

/* Streams of DMA 1. */
#define DMA1_STREAM(n) (0x40026010U + 0x18U * (n))
#define DMA_CR(stream) REGISTER((stream) + 0x00U)
#define DMA_CR_EN (1U << 0)
#define DMA_CR_TO_PERIPHERAL (1U << 6)
#define DMA_CR_CIRC (1U << 8)
#define DMA_CR_MINC (1U << 10)
#define DMA_CR_HALF_WORDS ((1U << 11) | (1U << 13))
#define DMA_CR_CHANNEL(n) ((uint32_t)(n) << 25)
#define DMA_NDTR(stream) REGISTER((stream) + 0x04U)
#define DMA_PAR(stream) REGISTER((stream) + 0x08U)
#define DMA_M0AR(stream) REGISTER((stream) + 0x0CU)

/* Serial peripheral interface 2. */
#define SPI2_CR1 REGISTER(0x40003800U)
#define SPI_CR1_MSTR (1U << 2)
#define SPI_CR1_SPE (1U << 6)
#define SPI_CR1_SSI (1U << 8)
#define SPI_CR1_SSM (1U << 9)
#define SPI_CR1_DFF (1U << 11)
#define SPI2_CR2 REGISTER(0x40003804U)
#define SPI2_SR REGISTER(0x40003808U)
#define SPI_SR_RXNE 1U
#define SPI2_DR_ADDRESS 0x4000380CU
#define SPI2_DR REGISTER(SPI2_DR_ADDRESS)

/* Cycle counter of the processor. */
#define DEMCR REGISTER(0xE000EDFCU)
#define DEMCR_TRCENA (1U << 24)
#define DWT_CTRL REGISTER(0xE0001000U)
#define DWT_CTRL_CYCCNTENA 1U
#define DWT_CYCCNT REGISTER(0xE0001004U)

/* Independent watchdog with its own clock of about 32 kHz. */
#define IWDG_KR REGISTER(0x40003000U)
#define IWDG_KR_UNLOCK 0x5555U
#define IWDG_KR_START 0xCCCCU
#define IWDG_KR_FEED 0xAAAAU
#define IWDG_PR REGISTER(0x40003004U)
#define IWDG_PR_4 0U
#define IWDG_RLR REGISTER(0x40003008U)

#endif
