/* SPDX-License-Identifier: Apache-2.0 */
/* Interface between board and firmware (port contract): functions of a board and their semantics.

   A board fills a struct port for each controller. The board calls app_start once, app_tick in
   every tick, and app_poll as often as possible (firmware/app/app.h). app_tick may interrupt
   app_poll, never the other way round; a board without interrupts calls them in turn. Controllers
   share nothing, and each has its own ticks.

   Time: tick n begins at t_n = n/rate. The board samples all sensors at t_n and calls app_tick. The
   reference current of this tick applies from t_(n+1) to t_(n+2), never earlier. Therefore, a tick
   may compute for a full period, and the delay from sample to current is always one tick.

   If app_tick is still running when the next tick begins, that tick is missed. It is not repeated,
   and the reference current remains for one more tick. The board counts ticks independently of
   app_tick, so that the next sample's tick number shows how many were missed. If app_tick is not
   called any more, a hardware watchdog of the board must bring the current to zero. */
#ifndef ANHYST_FIRMWARE_PORT_H
#define ANHYST_FIRMWARE_PORT_H

#include <stdint.h>

/* Code of the value 1.0 of a measured quantity. Gap, force and current are q30, so that a sensor
   can exceed full scale. Position and driven currents are q31. The board saturates values outside
   the range of int32_t. The lowest value is INT32_MIN + 1, because INT32_MIN is PORT_RESERVED. */
#define PORT_ONE ((int32_t)0x40000000)

/* Replaces a value if the sensor sent an error code or an undefined code. */
#define PORT_RESERVED INT32_MIN

/* Bits of port_sample.status. All bits except PORT_NO_SAMPLE are set at least as long as their
   cause exists. The hardware may latch them until the power stage is switched on again. */
#define PORT_NO_SAMPLE 1U      /* the sample has no values, but its tick number is valid */
#define PORT_AMPLIFIER 2U      /* an amplifier reports a fault, or does not answer */
#define PORT_EMERGENCY_STOP 4U /* the emergency stop is open */
#define PORT_OVER_CURRENT 8U   /* the hardware detected over-current and switched the current off */
#define PORT_SUPPLY 16U        /* the supply voltage is too low */
#define PORT_TOO_WARM 32U      /* the I^2 t limit of the winding or the power stage is exceeded */

/* Maximum number of currents: one magnet, or two that pull against each other. */
#define PORT_CURRENTS 2

/* A force controller needs gap and force; a position controller needs the position. The values that
   a controller does not need are 0, and so is the second current if there is one magnet. */
typedef struct {
  uint32_t tick;                  /* number of the last sample + 1 + missed ticks; wraps around */
  int32_t gap;                    /* q30: 0 and 1.0 are the ends of the model's gap range */
  int32_t force;                  /* q30 of the full-scale force */
  int32_t position;               /* q31 of the controller's full scale, upwards positive */
  int32_t current[PORT_CURRENTS]; /* q30 of the full-scale current: measured currents at t_n */
  uint32_t status;                /* bits of PORT_..., or 0 */
} port_sample;

/* Functions of a board. All functions are required; each receives the context. */
struct port {
  void *context; /* object of the board for this controller */

  /* Fills the sample of the present tick. Each app_tick calls it once. All values were sampled at
     t_n. Must not wait: if a converter has not finished, sets PORT_NO_SAMPLE. */
  void (*sense)(void *context, port_sample *sample);

  /* Sets the PORT_CURRENTS reference currents from t_(n+1) on, q31 of full scale. Each app_tick
     calls it once, also in the state FAULT. state: controller state + 256*fault reason. A board may
     display the state. At zero currents in the state FAULT, it may switch its power stage off. */
  void (*drive)(void *context, const int32_t *currents, uint32_t state);

  /* Reads up to `size` received bytes of the link in order, and returns their number; 0 if there
     are none. Must not wait. Bytes with line errors may be dropped or passed to the checksum. */
  uint16_t (*link_read)(void *context, uint8_t *bytes, uint16_t size);

  /* Accepts up to `count` bytes for sending in order, and returns their number. Must not wait.
     Accepted bytes are sent without further calls. The caller offers the other bytes again. */
  uint16_t (*link_write)(void *context, const uint8_t *bytes, uint16_t count);

  /* Lock and unlock: app_tick of this controller does not run between these calls. app_poll locks
     for a few dozen instructions, never nested. A board that calls app_tick and app_poll in turn
     may leave both functions empty. */
  void (*lock)(void *context);
  void (*unlock)(void *context);

  /* Stores a parameter block of `words` words for the next start. app_poll calls it at zero
     current. The board may stop its ticks for seconds during this call. Returns 1, or 0 if the
     block was not stored. */
  int (*keep)(void *context, const int16_t *block, uint16_t words);
};

static inline void port_lock(const struct port *port) { port->lock(port->context); }

static inline void port_unlock(const struct port *port) { port->unlock(port->context); }

#endif
