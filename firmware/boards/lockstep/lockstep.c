/* SPDX-License-Identifier: Apache-2.0 */
#include "lockstep.h"

#include "boards/actuator.h"
#include "app/app.h"
#include "port/port.h"

/* A virtual plant is trusted to show noise, as a real one does: a code that repeats for 256 ticks
   while the current moves by a twentieth is no noise. What a jump of the demand does in one tick,
   force and current from end to end, is plausible here. */
static const app_limits limits = {
    .gap = {-PORT_ONE / 20, PORT_ONE / 20 * 21, PORT_ONE / 20, 256},
    .force = {-PORT_ONE / 4, PORT_ONE / 4 * 5, PORT_ONE, 256},
    .current = {-PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, 256},
    .current_low = INT32_MIN,
    .current_high = INT32_MAX,
    .stuck_current = INT32_MAX / 20,
    .doubtful_ticks = 3,
    .missed_ticks = 2,
    .selftest_ticks = 16,
    .ramp_ms = 20,
    .heartbeat_ms = 500,
};

static const int16_t scales[ANHYST_SCALE_WORDS] = ACTUATOR_SCALES;

static const app_board board = {
    .kernel = &ACTUATOR_KERNEL,
    .words = ACTUATOR_PARAMETERS,
    .words_capacity = ACTUATOR_PARAMETERS_WORDS,
    .scales = scales,
    .firmware = BOARD_FIRMWARE_VERSION,
    .rate = ACTUATOR_RATE_HZ,
    .limits = &limits,
};

static app firmware;
static uint8_t record[LINK_SIZE_PLANT_SAMPLE];
static uint16_t filled;
static link_plant_sample sample;

void lockstep_start(void) { app_start(&firmware, &board); }

void lockstep_poll(void) { app_poll(&firmware); }

void lockstep_receive(uint8_t byte)
{
  record[filled++] = byte;
  if (filled < LINK_SIZE_PLANT_SAMPLE) {
    return;
  }
  if (link_get_plant_sample(&sample, record)) {
    filled = 0;
    app_tick(&firmware);
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
  to->current[0] = sample.current;
  to->current[1] = sample.current_2;
  to->status = sample.status;
}

void port_drive(const int32_t *currents, uint32_t state)
{
  uint8_t bytes[LINK_SIZE_PLANT_DRIVE];
  const link_plant_drive drive = {sample.tick, currents[0], currents[1], state};
  link_put_plant_drive(bytes, &drive);
  board_plant_write(bytes, LINK_SIZE_PLANT_DRIVE);
}

/* app_tick and app_poll are called in turn. */
void port_lock(void) {}
void port_unlock(void) {}
