/* SPDX-License-Identifier: Apache-2.0 */
#include "library.h"

#include <string.h>

#include "link/frames.h"
#include "lockstep.h"
#include "port/port.h"

static const uint8_t *in; /* what the caller has for the link, and how much of it is left */
static uint16_t in_count;
static uint8_t out[16384]; /* what the firmware has said and nobody took; more stays with it */
static uint16_t out_count;
static uint8_t *answer; /* where the drive of the tick belongs */

uint16_t port_link_read(uint8_t *bytes, uint16_t most)
{
  const uint16_t count = in_count < most ? in_count : most;
  if (count > 0U) {
    memcpy(bytes, in, count);
    in += count;
    in_count = (uint16_t)(in_count - count);
  }
  return count;
}

uint16_t port_link_write(const uint8_t *bytes, uint16_t count)
{
  const uint16_t room = (uint16_t)(sizeof out - out_count);
  const uint16_t taken = count < room ? count : room;
  memcpy(out + out_count, bytes, taken);
  out_count = (uint16_t)(out_count + taken);
  return taken;
}

void board_plant_write(const uint8_t *bytes, uint16_t count)
{
  memcpy(answer, bytes, count);
  answer += count;
}

void board_ticked(void) {}

void library_start(void) { (void)lockstep_start(); }

void library_tick(const uint8_t *sample, uint8_t *drive)
{
  answer = drive;
  for (unsigned i = 0; i < LINK_SIZE_PLANT_SAMPLE; ++i) {
    lockstep_receive(sample[i]);
  }
  lockstep_poll();
}

uint16_t library_link(const uint8_t *bytes, uint16_t count, uint8_t *said, uint16_t most)
{
  uint16_t before = 0;
  in = bytes;
  in_count = count;
  do {
    before = (uint16_t)(in_count + out_count);
    lockstep_poll();
  } while (in_count + out_count != before);
  const uint16_t taken = out_count < most ? out_count : most;
  memcpy(said, out, taken);
  memmove(out, out + taken, (size_t)(out_count - taken));
  out_count = (uint16_t)(out_count - taken);
  return taken;
}
