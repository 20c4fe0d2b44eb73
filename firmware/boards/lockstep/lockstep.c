/* SPDX-License-Identifier: Apache-2.0 */
#include "lockstep.h"

#include "port/port.h"
#include "xcp/tunnel.h"

static app firmware;
static xcp_slave carried; /* by the link */
static uint8_t record[LINK_SIZE_PLANT_SAMPLE];
static uint16_t filled;
static link_plant_sample sample;
static link_plant_drive drive;

app *lockstep_start(void)
{
  app_start(&firmware, &lockstep_board);
  xcp_start(&carried, &firmware);
  return &firmware;
}

void lockstep_poll(void) { app_poll(&firmware); }

/* Sends what the tick drove, and the signals that the plant does not know. */
static void answer(void)
{
  uint8_t bytes[LINK_SIZE_PLANT_DRIVE];
  const int32_t *signals = firmware.signals;
  drive.tick = sample.tick;
  drive.mode =
      (uint32_t)signals[LINK_SIGNAL_FLAGS] + (65536U * (uint32_t)signals[LINK_SIGNAL_PHASE]);
  drive.demand = signals[LINK_SIGNAL_DEMAND];
  drive.reference = signals[LINK_SIGNAL_REFERENCE];
  drive.flux = signals[LINK_SIGNAL_FLUX];
  drive.expected = signals[LINK_SIGNAL_EXPECTED];
  link_put_plant_drive(bytes, &drive);
  board_plant_write(bytes, LINK_SIZE_PLANT_DRIVE);
}

void lockstep_receive(uint8_t byte)
{
  record[filled++] = byte;
  if (filled < LINK_SIZE_PLANT_SAMPLE) {
    return;
  }
  if (link_get_plant_sample(&sample, record)) {
    filled = 0;
    app_tick(&firmware);
    answer();
    xcp_tick(&carried);
    board_ticked();
    return;
  }
  for (uint16_t i = 1; i < LINK_SIZE_PLANT_SAMPLE; ++i) {
    record[i - 1] = record[i];
  }
  --filled;
}

void port_sense(port_sample *to)
{
  to->tick = sample.tick;
  to->gap = sample.gap;
  to->force = sample.force;
  to->position = sample.position;
  to->current[0] = sample.current[0];
  to->current[1] = sample.current[1];
  to->status = sample.status;
}

void port_drive(const int32_t *currents, uint32_t state)
{
  drive.drive[0] = currents[0];
  drive.drive[1] = currents[1];
  drive.state = state;
}

/* app_tick and app_poll are called in turn. */
void port_lock(void) {}
void port_unlock(void) {}

/* A process and an emulator forget all when they end, and their cycles say nothing. */
int port_keep(const int16_t *block, uint16_t words)
{
  (void)block;
  (void)words;
  return 0;
}

uint32_t port_cycles(void) { return 0; }

uint16_t port_xcp(const uint8_t *command, uint16_t length, uint8_t *packets)
{
  return xcp_tunnel(&carried, command, length, packets);
}
