/* SPDX-License-Identifier: Apache-2.0 */
/* Port for the host, as a process. It reads requests from standard input, and writes the mailbox,
 * the memory block harness_box, to standard output. A request is the part of the mailbox before
 * box_words, followed by the records in its window. */
#include <stddef.h>
#include <stdio.h>

#include "harness.h"

#define QUIT 0xFFFFFFFFU

static int served = 0;

void harness_wait(void)
{
  /* The mailbox is volatile for the targets; on the host, no other thread accesses it. */
  harness_box_layout *box = (harness_box_layout *)(uintptr_t)&harness_box;
  if (served && (fwrite(box, sizeof *box, 1, stdout) != 1 || fflush(stdout) != 0)) {
    harness_box.mode = QUIT;
    return;
  }
  served = 1;
  if (fread(box, offsetof(harness_box_layout, box_words), 1, stdin) != 1 ||
      fread(box->window, sizeof box->window, 1, stdin) != 1) {
    harness_box.mode = QUIT;
  }
}

void harness_clock_start(void) {}

uint32_t harness_clock_stop(void) { return 0; }

uintptr_t harness_stack_pointer(void) { return 0; }

uintptr_t harness_stack_end(void) { return 0; }

int main(void) { return harness_main(); }
