/* SPDX-License-Identifier: Apache-2.0 */
/* Cortex-M under an emulator that counts instructions.

   The emulator stops at harness_wait, zeroes its count at harness_clock_start, and writes it to
   harness_count at harness_clock_stop: each is a function so that it begins a block of the
   emulator's, which counts by blocks. */
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

/* What the run-time ABI calls by names of its own. */
void __aeabi_memclr(void *to, __SIZE_TYPE__ n);
void __aeabi_memclr4(void *to, __SIZE_TYPE__ n);
void __aeabi_memclr8(void *to, __SIZE_TYPE__ n);
void __aeabi_memcpy(void *restrict to, const void *restrict from, __SIZE_TYPE__ n);
void __aeabi_memcpy4(void *restrict to, const void *restrict from, __SIZE_TYPE__ n);
void __aeabi_memcpy8(void *restrict to, const void *restrict from, __SIZE_TYPE__ n);

void __aeabi_memclr(void *to, __SIZE_TYPE__ n) { memset(to, 0, n); }

void __aeabi_memclr4(void *to, __SIZE_TYPE__ n) { memset(to, 0, n); }

void __aeabi_memclr8(void *to, __SIZE_TYPE__ n) { memset(to, 0, n); }

void __aeabi_memcpy(void *restrict to, const void *restrict from, __SIZE_TYPE__ n)
{
  memcpy(to, from, n);
}

void __aeabi_memcpy4(void *restrict to, const void *restrict from, __SIZE_TYPE__ n)
{
  memcpy(to, from, n);
}

void __aeabi_memcpy8(void *restrict to, const void *restrict from, __SIZE_TYPE__ n)
{
  memcpy(to, from, n);
}

/* Cortex-M0+ has no division. */
uint32_t __aeabi_uidiv(uint32_t a, uint32_t b);
int32_t __aeabi_idiv(int32_t a, int32_t b);

uint32_t __aeabi_uidiv(uint32_t a, uint32_t b)
{
  uint32_t rest;
  return freestanding_divide(a, b, &rest);
}

int32_t __aeabi_idiv(int32_t a, int32_t b)
{
  int32_t rest;
  return freestanding_divide_signed(a, b, &rest);
}

/* Quotient in r0, rest in r1: as one 64-bit number. */
uint64_t __aeabi_uidivmod(uint32_t a, uint32_t b);
uint64_t __aeabi_idivmod(int32_t a, int32_t b);

uint64_t __aeabi_uidivmod(uint32_t a, uint32_t b)
{
  uint32_t rest;
  const uint32_t quotient = freestanding_divide(a, b, &rest);
  return (uint64_t)rest << 32 | quotient;
}

uint64_t __aeabi_idivmod(int32_t a, int32_t b)
{
  int32_t rest;
  const int32_t quotient = freestanding_divide_signed(a, b, &rest);
  return (uint64_t)(uint32_t)rest << 32 | (uint32_t)quotient;
}

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
