/* SPDX-License-Identifier: Apache-2.0 */
/* Counts the executed instructions of an emulated processor, block by block, as a hook of Unicorn.
 * A hook for each instruction would not count predicated instructions that are not executed. All
 * instructions of a block are counted. As native code, the hook costs almost no time. */
#include <stdint.h>

/* Costs of the half-words of the code, as prefix sums: a block costs prefix[end] - prefix[begin].
 */
typedef struct {
  uint32_t code_begin, code_end;
  const uint32_t *prefix; /* one entry per half-word, and one more */
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
