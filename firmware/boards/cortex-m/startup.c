/* SPDX-License-Identifier: Apache-2.0 */
#include "startup.h"

#include <stddef.h>

/* From the linker script: where initial values lie and where they belong, and what starts as 0. */
extern uint32_t startup_data_stored;
extern uint32_t startup_data_begin;
extern uint32_t startup_data_end;
extern uint32_t startup_zero_begin;
extern uint32_t startup_zero_end;

int main(void);

void startup_reset(void)
{
  const uint32_t *from = &startup_data_stored;
  for (uint32_t *to = &startup_data_begin; to < &startup_data_end; ++to) {
    *to = *from++;
  }
  for (uint32_t *to = &startup_zero_begin; to < &startup_zero_end; ++to) {
    *to = 0;
  }
  (void)main();
  startup_trap();
}

void startup_trap(void)
{
  startup_interrupts_off();
  board_panic();
  for (;;) {
  }
}

/* A compiler may ask for these by itself, also where there is no C library: by their names in C and
   by those of Arm's run-time interface. volatile, or a compiler would see through the loop and call
   the function from within itself. */
// NOLINTBEGIN(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp)
void *memcpy(void *to, const void *from, size_t n);
void *memset(void *to, int value, size_t n);
void __aeabi_memcpy(void *to, const void *from, size_t n);
void __aeabi_memcpy4(void *to, const void *from, size_t n);
void __aeabi_memclr(void *to, size_t n);
void __aeabi_memclr4(void *to, size_t n);

void *memcpy(void *to, const void *from, size_t n)
{
  volatile unsigned char *t = to;
  const unsigned char *f = from;
  for (size_t i = 0; i < n; ++i) {
    t[i] = f[i];
  }
  return to;
}

void *memset(void *to, int value, size_t n)
{
  volatile unsigned char *t = to;
  for (size_t i = 0; i < n; ++i) {
    t[i] = (unsigned char)value;
  }
  return to;
}

void __aeabi_memcpy(void *to, const void *from, size_t n) { (void)memcpy(to, from, n); }
void __aeabi_memcpy4(void *to, const void *from, size_t n) { (void)memcpy(to, from, n); }
void __aeabi_memclr(void *to, size_t n) { (void)memset(to, 0, n); }
void __aeabi_memclr4(void *to, size_t n) { (void)memset(to, 0, n); }
// NOLINTEND(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp)
