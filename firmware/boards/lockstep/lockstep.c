/* SPDX-License-Identifier: Apache-2.0 */
#include "lockstep.h"

static void sense(void *context, port_sample *to)
{
  const link_plant_sample *sample = &((const lockstep *)context)->sample;
  to->tick = sample->tick;
  to->gap = sample->gap;
  to->force = sample->force;
  to->position = sample->position;
  to->current[0] = sample->current[0];
  to->current[1] = sample->current[1];
  to->status = sample->status;
}

static void drive(void *context, const int32_t *currents, uint32_t state)
{
  lockstep *l = context;
  l->drive.drive[0] = currents[0];
  l->drive.drive[1] = currents[1];
  l->drive.state = state;
}

/* No lock is needed: app_tick and app_poll are called in turn. */
static void skip_lock(void *context) { (void)context; }

/* Processes and emulators have no non-volatile memory. */
static int refuse_to_store(void *context, const int16_t *block, uint16_t words)
{
  (void)context;
  (void)block;
  (void)words;
  return 0;
}

void lockstep_start(lockstep *l,
                    uint16_t (*link_read)(void *context, uint8_t *bytes, uint16_t size),
                    uint16_t (*link_write)(void *context, const uint8_t *bytes, uint16_t count))
{
  const struct port port = {.context = l,
                            .sense = sense,
                            .drive = drive,
                            .link_read = link_read,
                            .link_write = link_write,
                            .lock = skip_lock,
                            .unlock = skip_lock,
                            .keep = refuse_to_store};
  l->port = port;
  l->received_count = 0;
  app_start(&l->firmware, &l->body, &lockstep_board, &l->port);
}

void lockstep_tick(lockstep *l)
{
  const int32_t *signals = l->firmware.signals;
  app_tick(&l->firmware);
  l->drive.tick = l->sample.tick;
  l->drive.mode =
      (uint32_t)signals[LINK_SIGNAL_FLAGS] + (65536U * (uint32_t)signals[LINK_SIGNAL_PHASE]);
  l->drive.demand = signals[LINK_SIGNAL_DEMAND];
  l->drive.reference = signals[LINK_SIGNAL_REFERENCE];
  l->drive.flux = signals[LINK_SIGNAL_FLUX];
  l->drive.expected = signals[LINK_SIGNAL_EXPECTED];
}

int lockstep_receive(lockstep *l, uint8_t byte, uint8_t *answer)
{
  l->arriving[l->received_count++] = byte;
  if (l->received_count < LINK_SIZE_PLANT_SAMPLE) {
    return 0;
  }
  if (link_get_plant_sample(&l->sample, l->arriving)) {
    l->received_count = 0;
    lockstep_tick(l);
    link_put_plant_drive(answer, &l->drive);
    return 1;
  }
  for (uint16_t i = 1; i < LINK_SIZE_PLANT_SAMPLE; ++i) {
    l->arriving[i - 1] = l->arriving[i];
  }
  --l->received_count;
  return 0;
}
