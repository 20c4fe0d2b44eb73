/* SPDX-License-Identifier: Apache-2.0 */
#include "library.h"

#include <string.h>

#include "lockstep.h"

typedef struct {
  lockstep lockstep;
  const uint8_t *unread_bytes; /* bytes from the caller that the firmware has not read */
  uint16_t unread_count;
  uint16_t unfetched_count;
  uint8_t out[16384]; /* sent bytes that the caller has not fetched yet */
} library;

static uint16_t link_read(void *context, uint8_t *bytes, uint16_t size)
{
  library *l = context;
  const uint16_t count = l->unread_count < size ? l->unread_count : size;
  if (count > 0U) {
    memcpy(bytes, l->unread_bytes, count);
    l->unread_bytes += count;
    l->unread_count = (uint16_t)(l->unread_count - count);
  }
  return count;
}

static uint16_t link_write(void *context, const uint8_t *bytes, uint16_t count)
{
  library *l = context;
  const uint16_t free_bytes = (uint16_t)(sizeof l->out - l->unfetched_count);
  const uint16_t taken = count < free_bytes ? count : free_bytes;
  memcpy(l->out + l->unfetched_count, bytes, taken);
  l->unfetched_count = (uint16_t)(l->unfetched_count + taken);
  return taken;
}

size_t library_bytes(void) { return sizeof(library); }

void library_start(void *controller)
{
  library *l = controller;
  l->unread_count = 0;
  l->unfetched_count = 0;
  lockstep_start(&l->lockstep, link_read, link_write);
}

void library_tick(void *controller, const void *sample, void *drive)
{
  lockstep *l = &((library *)controller)->lockstep;
  memcpy(&l->sample, sample, sizeof l->sample);
  lockstep_tick(l);
  memcpy(drive, &l->drive, sizeof l->drive);
  app_poll(&l->firmware);
}

uint16_t library_link(void *controller, const uint8_t *bytes, uint16_t count, uint8_t *sent,
                      uint16_t size)
{
  library *l = controller;
  uint16_t before = 0;
  l->unread_bytes = bytes;
  l->unread_count = count;
  do {
    before = (uint16_t)(l->unread_count + l->unfetched_count);
    app_poll(&l->lockstep.firmware);
  } while (l->unread_count + l->unfetched_count != before);
  const uint16_t taken = l->unfetched_count < size ? l->unfetched_count : size;
  memcpy(sent, l->out, taken);
  memmove(l->out, l->out + taken, (size_t)(l->unfetched_count - taken));
  l->unfetched_count = (uint16_t)(l->unfetched_count - taken);
  return taken;
}
