/* SPDX-License-Identifier: Apache-2.0 */
/* Counts what an emulated processor executes, block by block, as a hook of Unicorn's.

   A hook for each instruction would miss those that are predicated and not executed; a block's
   instructions all take their turn. As native code this costs next to nothing. */
#include <stdint.h>

/* What one half-word of code costs before it and all before it: prefix sums, so that a block costs
   prefix[end] - prefix[begin]. */
typedef struct {
  uint32_t code_begin, code_end;
  const uint32_t *prefix; /* one entry a half-word, and one more */
  uint32_t start, stop;   /* addresses of harness_clock_start and harness_clock_stop */
  uint32_t *result;       /* harness_count, in the memory of the emulated processor */
  uint64_t count;
} counter;

#ifdef _WIN32
__declspec(dllexport)
#endif
void count_block(void *emulator, uint64_t address, uint32_t size, void *user)
{
  counter *c = user;
  (void)emulator;
  if (address < c->code_begin || address + size > c->code_end) {
    return;
  }
  if (address == c->stop) {
    *c->result = (uint32_t)c->count;
  }
  const uint32_t begin = ((uint32_t)address - c->code_begin) / 2;
  c->count += c->prefix[begin + size / 2] - c->prefix[begin];
  if (address == c->start) {
    c->count = 0;
  }
}
