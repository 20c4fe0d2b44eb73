/* SPDX-License-Identifier: Apache-2.0 */
/* Port for an AVR under simavr. avr_runner.c monitors three general-purpose registers. */
#include <avr/io.h>

#include "harness.h"

volatile uint32_t harness_count;

void harness_wait(void)
{
  GPIOR0 = 1; /* the runner stops here and fills the mailbox */
  __asm__ volatile("nop" ::: "memory");
}

void harness_clock_start(void) { GPIOR1 = 1; /* the runner stores the cycle */ }

uint32_t harness_clock_stop(void)
{
  GPIOR2 = 1; /* the runner writes harness_count */
  return harness_count;
}

/* The return address of this call takes 2 bytes. */
uintptr_t harness_stack_pointer(void) { return SP + 2U; }

extern unsigned char _end[]; /* avr-libc's linker script: end of .bss */

uintptr_t harness_stack_end(void) { return (uintptr_t)_end; }

int main(void) { return harness_main(); }
