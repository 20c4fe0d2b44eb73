/* SPDX-License-Identifier: Apache-2.0 */
/* Runs an AVR program in simavr, which models cycles. Requests come from standard input, and
 * mailboxes go to standard output, as in host.c. Arguments: the ELF file, the processor, the
 * addresses of harness_box and harness_count in data memory, the number of bytes that the host
 * fills at the start of the mailbox, the offset of the window, and the size of the mailbox. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <sim_avr.h>
#include <sim_elf.h>

#include "avr_mcu_section.h"

/* Data addresses of GPIOR0, GPIOR1, GPIOR2 in the ATmega family. */
#define WAIT_REGISTER 0x3E
#define CLOCK_START 0x4A
#define CLOCK_STOP 0x4B

static int waiting = 0;
static avr_cycle_count_t started = 0;
static unsigned count_at = 0;

static void on_wait(avr_t *avr, avr_io_addr_t address, uint8_t value, void *user)
{
  (void)avr, (void)address, (void)value, (void)user;
  waiting = 1;
}

static void on_start(avr_t *avr, avr_io_addr_t address, uint8_t value, void *user)
{
  (void)address, (void)value, (void)user;
  started = avr->cycle;
}

static void on_stop(avr_t *avr, avr_io_addr_t address, uint8_t value, void *user)
{
  (void)address, (void)value, (void)user;
  const uint32_t elapsed = (uint32_t)(avr->cycle - started);
  for (unsigned i = 0; i < 4; i++) {
    avr->data[count_at + i] = (uint8_t)(elapsed >> (8 * i));
  }
}

int main(int argc, char **argv)
{
  if (argc != 8) {
    (void)fputs("usage: avr_runner ELF MCU BOX COUNT HEAD WINDOW BYTES\n", stderr);
    return 2;
  }
  /* simavr prints to standard output. Therefore the mailboxes get their own stream. */
  FILE *boxes = fdopen(dup(STDOUT_FILENO), "wb");
  if (boxes == NULL || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) {
    return 1;
  }
  elf_firmware_t firmware = {0};
  if (elf_read_firmware(argv[1], &firmware) != 0) {
    (void)fprintf(stderr, "%s: not an ELF file\n", argv[1]);
    return 2;
  }
  const unsigned box = (unsigned)strtoul(argv[3], NULL, 0);
  count_at = (unsigned)strtoul(argv[4], NULL, 0);
  const size_t head = strtoul(argv[5], NULL, 0);
  const size_t window = strtoul(argv[6], NULL, 0);
  const size_t bytes = strtoul(argv[7], NULL, 0);
  avr_t *avr = avr_make_mcu_by_name(argv[2]);
  if (avr == NULL) {
    (void)fprintf(stderr, "simavr does not know the processor %s\n", argv[2]);
    return 2;
  }
  avr_init(avr);
  avr_load_firmware(avr, &firmware);
  avr_register_io_write(avr, WAIT_REGISTER, on_wait, NULL);
  avr_register_io_write(avr, CLOCK_START, on_start, NULL);
  avr_register_io_write(avr, CLOCK_STOP, on_stop, NULL);
  for (int served = 0;; served = 1) {
    for (waiting = 0; !waiting;) {
      const int state = avr_run(avr);
      if (state == cpu_Done || state == cpu_Crashed) {
        (void)fprintf(stderr, "the program ran astray at %#x\n", (unsigned)avr->pc);
        return 1;
      }
    }
    if (served && (fwrite(avr->data + box, bytes, 1, boxes) != 1 || fflush(boxes) != 0)) {
      return 1;
    }
    if (fread(avr->data + box, head, 1, stdin) != 1 ||
        fread(avr->data + box + window, bytes - window, 1, stdin) != 1) {
      return 0;
    }
  }
}
