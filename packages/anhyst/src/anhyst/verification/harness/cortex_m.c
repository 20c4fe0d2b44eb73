/* SPDX-License-Identifier: Apache-2.0 */
/* Port for a Cortex-M in an emulator that counts instructions.
 *
 * The emulator stops at harness_wait, clears its count at harness_clock_start, and writes it to
 * harness_count at harness_clock_stop. The emulator counts by basic blocks. Each of the three
 * functions therefore begins a block. */
#include "freestanding.h"
#include "harness.h"

int main(void);
void reset(void);

extern unsigned char link_stack_end[];
extern unsigned char link_stack_top[];
extern unsigned char link_bss[], link_bss_end[];
extern unsigned char link_data[], link_data_end[], link_data_image[];

volatile uint32_t harness_count;

__attribute__((noinline)) void harness_wait(void) { __asm__ volatile("nop" ::: "memory"); }

__attribute__((noinline)) void harness_clock_start(void) { __asm__ volatile("" ::: "memory"); }

__attribute__((noinline)) uint32_t harness_clock_stop(void) { return harness_count; }

__attribute__((noinline)) uintptr_t harness_stack_pointer(void)
{
  uintptr_t sp;
  __asm__ volatile("mov %0, sp" : "=r"(sp));
  return sp;
}

uintptr_t harness_stack_end(void) { return (uintptr_t)link_stack_end; }

int main(void) { return harness_main(); }

__attribute__((section(".reset"))) void reset(void)
{
  memcpy(link_data, link_data_image, (__SIZE_TYPE__)(link_data_end - link_data));
  memset(link_bss, 0, (__SIZE_TYPE__)(link_bss_end - link_bss));
  (void)main();
  for (;;) {
    harness_wait();
  }
}
