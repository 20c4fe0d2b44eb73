/* SPDX-License-Identifier: Apache-2.0 */
#include "startup.h"

#include <stddef.h>

/* Symbols of the linker script: source and target of the initial values, and the zeroed range. */
extern uint32_t startup_data_stored;
extern uint32_t startup_data_begin;
extern uint32_t startup_data_end;
extern uint32_t startup_zero_begin;
extern uint32_t startup_zero_end;

int main(void);

/* Address of a symbol of the linker script as a number. */
#define ADDRESS(symbol) ((uintptr_t)&(symbol))

void startup_reset(void)
{
  uintptr_t from = ADDRESS(startup_data_stored);
  for (uintptr_t to = ADDRESS(startup_data_begin); to < ADDRESS(startup_data_end); to += 4U) {
    REGISTER(to) = REGISTER(from);
    from += 4U;
  }
  for (uintptr_t to = ADDRESS(startup_zero_begin); to < ADDRESS(startup_zero_end); to += 4U) {
    REGISTER(to) = 0;
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

/* A compiler may insert calls of these functions, also without a C library: by their C names or the
   names of Arm's run-time ABI. Because of volatile, a loop does not become a call of its own
   function. */
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
