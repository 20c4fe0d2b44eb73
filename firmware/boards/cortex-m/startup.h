/* SPDX-License-Identifier: Apache-2.0 */
/* Startup code from reset to main, and registers of the core, for all Cortex-M boards. */
#ifndef STARTUP_H
#define STARTUP_H

#include <stdint.h>

/* Register at an address. */
#define REGISTER(address) (*(volatile uint32_t *)(address))

#define NVIC_ENABLE(n) REGISTER(0xE000E100U + 4U * ((uint32_t)(n) / 32U))
#define NVIC_CLEAR_PENDING(n) REGISTER(0xE000E280U + 4U * ((uint32_t)(n) / 32U))
#define NVIC_BIT(n) (1U << ((uint32_t)(n) % 32U))
#define NVIC_PRIORITY(n) (*(volatile uint8_t *)(0xE000E400U + (uint32_t)(n)))
#define SCB_CPACR REGISTER(0xE000ED88U) /* access control of the FPU */

typedef void (*startup_vector)(void);

/* First word of a vector table: top of the stack. Defined by the linker script. */
extern uint32_t startup_stack_top;

/* Second word of a vector table: initialises the memory and calls main, which does not return. */
void startup_reset(void);

/* Handler of unexpected exceptions: calls board_panic and stops. */
void startup_trap(void);

/* The first 16 entries of a vector table in the section .vectors, and the index of interrupt n.
   Disabled interrupts need no entry. */
#define STARTUP_VECTORS                                                                            \
  [0] = (startup_vector) & startup_stack_top, [1] = startup_reset, [2] = startup_trap,             \
  [3] = startup_trap, [4] = startup_trap, [5] = startup_trap, [6] = startup_trap,                  \
  [11] = startup_trap, [12] = startup_trap, [14] = startup_trap, [15] = startup_trap
#define STARTUP_INTERRUPT(n) (16 + (n))

/* Brings the actuator to a safe state. Each board defines it. It is called with interrupts off, and
   the stack may be corrupt. It must not wait. */
void board_panic(void);

static inline void startup_wait_for_interrupt(void) { __asm volatile("wfi" ::: "memory"); }
static inline void startup_interrupts_off(void) { __asm volatile("cpsid i" ::: "memory"); }
static inline void startup_interrupts_on(void) { __asm volatile("cpsie i" ::: "memory"); }

#endif
