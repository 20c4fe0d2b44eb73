/* SPDX-License-Identifier: Apache-2.0 */
/* The example of two magnets without an operating system: rows in flash instead of files. */
#include "freestanding.h"
#include "magnets.h"
#include "rows.h"

extern unsigned char link_bss[], link_bss_end[];
extern unsigned char link_data[], link_data_end[], link_data_image[];

void reset(void);
void ended(void);

volatile uint32_t started, rows, wrong;

__attribute__((noinline)) void ended(void) { __asm__ volatile("nop" ::: "memory"); }

__attribute__((section(".reset"))) void reset(void)
{
  memcpy(link_data, link_data_image, (__SIZE_TYPE__)(link_data_end - link_data));
  memset(link_bss, 0, (__SIZE_TYPE__)(link_bss_end - link_bss));
  started = (uint32_t)magnets_start();
  for (uint32_t row = 0; row < ROWS; row++) {
    int32_t current[MAGNETS];
    magnets_solve(demand[row], gap[row], current);
    magnets_commit(applied[row], gap[row]);
    for (uint32_t i = 0; i < MAGNETS; i++) {
      wrong += current[i] != expected[row][i];
    }
    rows++;
  }
  ended();
}
