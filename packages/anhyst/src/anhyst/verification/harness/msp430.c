/* SPDX-License-Identifier: Apache-2.0 */
/* Port for an MSP430 in mspdebug's simulator. Two timers form its clock: one counts cycles, and the
 * other counts every eighth cycle, so that an overflow of the first is detected.
 *
 * The file also contains functions that a C compiler calls and this processor lacks: long
 * multiplication (with the 16x16 hardware multiplier), division and long shifts. */
#include "freestanding.h"
#include "harness.h"

#define REGISTER(address) (*(volatile uint16_t *)(address))
#define FAST_CONTROL REGISTER(0x0160)
#define FAST_COUNT REGISTER(0x0170)
#define SLOW_CONTROL REGISTER(0x0180)
#define SLOW_COUNT REGISTER(0x0190)
#define TIMER_RUN 0x0224U     /* clock of the processor, continuous from 0 to 0xFFFF, cleared */
#define TIMER_EIGHTHS 0x00C0U /* one count for 8 cycles */
#define TIMER_STOP 0x0000U

#define MULTIPLY_UNSIGNED REGISTER(0x0130)
#define MULTIPLY_BY REGISTER(0x0138)
#define PRODUCT_LOW REGISTER(0x013A)
#define PRODUCT_HIGH REGISTER(0x013C)

int main(void);
void reset(void);
uint16_t __mspabi_mpyi(uint16_t a, uint16_t b);
uint32_t __mspabi_mpyl(uint32_t a, uint32_t b);
uint16_t __mspabi_divu(uint16_t a, uint16_t b);
uint16_t __mspabi_remu(uint16_t a, uint16_t b);
uint32_t __mspabi_divul(uint32_t a, uint32_t b);
uint32_t __mspabi_remul(uint32_t a, uint32_t b);
int32_t __mspabi_divli(int32_t a, int32_t b);
int32_t __mspabi_remli(int32_t a, int32_t b);
uint32_t __mspabi_slll(uint32_t a, uint16_t n);
uint32_t __mspabi_srll(uint32_t a, uint16_t n);
int32_t __mspabi_sral(int32_t a, uint16_t n);

extern unsigned char link_stack_end[];
extern unsigned char link_bss[], link_bss_end[];
extern unsigned char link_data[], link_data_end[], link_data_image[];

__attribute__((noinline)) void harness_wait(void) { __asm__ volatile("nop" ::: "memory"); }

__attribute__((noinline)) void harness_clock_start(void)
{
  SLOW_CONTROL = TIMER_RUN | TIMER_EIGHTHS;
  FAST_CONTROL = TIMER_RUN;
}

/* The count is exact up to 2^19 - 2^15 cycles. */
__attribute__((noinline)) uint32_t harness_clock_stop(void)
{
  FAST_CONTROL = TIMER_STOP;
  SLOW_CONTROL = TIMER_STOP;
  const uint32_t exact = FAST_COUNT;
  const uint32_t rough = (uint32_t)SLOW_COUNT << 3;
  /* Of all numbers with the low bits of the exact count, return the nearest to the rough count. */
  return rough + (uint32_t)(int32_t)(int16_t)(uint16_t)(exact - rough);
}

/* The return address of this call takes 2 bytes. */
__attribute__((noinline)) uintptr_t harness_stack_pointer(void)
{
  uintptr_t sp;
  __asm__ volatile("mov r1, %0" : "=r"(sp));
  return sp + 2U;
}

uintptr_t harness_stack_end(void) { return (uintptr_t)link_stack_end; }

uint16_t __mspabi_mpyi(uint16_t a, uint16_t b)
{
  MULTIPLY_UNSIGNED = a;
  MULTIPLY_BY = b;
  return PRODUCT_LOW;
}

uint32_t __mspabi_mpyl(uint32_t a, uint32_t b)
{
  const uint16_t a_low = (uint16_t)a;
  const uint16_t b_low = (uint16_t)b;
  MULTIPLY_UNSIGNED = (uint16_t)(a >> 16);
  MULTIPLY_BY = b_low;
  uint16_t high = PRODUCT_LOW;
  MULTIPLY_UNSIGNED = a_low;
  MULTIPLY_BY = (uint16_t)(b >> 16);
  high = (uint16_t)(high + PRODUCT_LOW);
  MULTIPLY_BY = b_low;
  high = (uint16_t)(high + PRODUCT_HIGH);
  return (uint32_t)high << 16 | PRODUCT_LOW;
}

uint32_t __mspabi_divul(uint32_t a, uint32_t b)
{
  uint32_t rest;
  return freestanding_divide(a, b, &rest);
}

uint32_t __mspabi_remul(uint32_t a, uint32_t b)
{
  uint32_t rest;
  (void)freestanding_divide(a, b, &rest);
  return rest;
}

int32_t __mspabi_divli(int32_t a, int32_t b)
{
  int32_t rest;
  return freestanding_divide_signed(a, b, &rest);
}

int32_t __mspabi_remli(int32_t a, int32_t b)
{
  int32_t rest;
  (void)freestanding_divide_signed(a, b, &rest);
  return rest;
}

uint16_t __mspabi_divu(uint16_t a, uint16_t b) { return (uint16_t)__mspabi_divul(a, b); }

uint16_t __mspabi_remu(uint16_t a, uint16_t b) { return (uint16_t)__mspabi_remul(a, b); }

/* Long shifts, a bit at a time. The empty instruction keeps the compiler from replacing a loop by a
 * call of the long shift. */
uint32_t __mspabi_slll(uint32_t a, uint16_t n)
{
  for (; n > 0; n--) {
    a <<= 1;
    __asm__ volatile("" : "+r"(n));
  }
  return a;
}

uint32_t __mspabi_srll(uint32_t a, uint16_t n)
{
  for (; n > 0; n--) {
    a >>= 1;
    __asm__ volatile("" : "+r"(n));
  }
  return a;
}

int32_t __mspabi_sral(int32_t a, uint16_t n)
{
  for (; n > 0; n--) {
    a >>= 1;
    __asm__ volatile("" : "+r"(n));
  }
  return a;
}

int main(void)
{
  memcpy(link_data, link_data_image, (__SIZE_TYPE__)(link_data_end - link_data));
  memset(link_bss, 0, (__SIZE_TYPE__)(link_bss_end - link_bss));
  return harness_main();
}

__attribute__((naked, section(".reset"))) void reset(void)
{
  __asm__ volatile("mov #link_stack_top, r1\n\tcall #main\n\tjmp .");
}

__attribute__((section(".vector"), used)) static void (*const vector)(void) = reset;
