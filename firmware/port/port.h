/* SPDX-License-Identifier: Apache-2.0 */
/* The port contract: what a board gives the firmware, and what each answer must mean.

   A board fills a struct port for each of its controllers, calls app_start once, then app_tick once
   every tick and app_poll as often as it can in between (firmware/app/app.h). app_tick may
   interrupt app_poll, never the other way round; a board without interrupts calls them in turn.
   Controllers share nothing: each has its own ticks.

   Time. Tick n begins at t_n = n/rate. The board samples all sensors at t_n, calls app_tick, and
   lets the current that app_tick drives begin to flow at t_n+1 and not before, however early
   the board was told; it is held until t_n+2. So a tick has one whole period to compute, and
   the delay from a sample to what follows from it is one tick, always.

   If app_tick of a tick is not done when the next tick begins, the next one is missed: it is not
   made up for, the current stays as it is for one tick longer, and the tick number of the next
   sample reports to the firmware how many were left out. A board must bring the current to zero by
   itself if app_tick stops being called altogether (a hardware watchdog of a few ticks). */
#ifndef ANHYST_FIRMWARE_PORT_H
#define ANHYST_FIRMWARE_PORT_H

#include <stdint.h>

/* Measured values are q30, so that a sensor can show more than full scale: 1.0 is 2^30.
   A sensor whose value does not fit gives the largest or smallest number, PORT_RESERVED excepted.
 */
#define PORT_ONE ((int32_t)0x40000000)

/* Instead of a value: this sensor sent its error code, or its code cannot be one of a value. */
#define PORT_RESERVED INT32_MIN

/* Bits of port_sample.status. A bit of the hardware stays as long as its cause does, and may stay
   until the power stage was switched on again. */
#define PORT_NO_SAMPLE 1U      /* there are no values; the tick is right all the same */
#define PORT_AMPLIFIER 2U      /* an amplifier reports a fault, or does not answer */
#define PORT_EMERGENCY_STOP 4U /* the emergency stop is open */
#define PORT_OVER_CURRENT 8U   /* the hardware saw more current than can be, and took it away */
#define PORT_SUPPLY 16U        /* the supply sags: what is asked for cannot be driven for long */
#define PORT_TOO_WARM 32U      /* winding or power stage: I^2 t has passed its limit */

/* Currents that a board has: of one magnet, or of two that pull against each other. */
#define PORT_CURRENTS 2

/* A board whose controller is one of force fills gap and force, one of position fills position; the
   others, and the second current where there is one magnet, are 0. */
typedef struct {
  uint32_t tick;    /* n: one more than at the last tick, or as many more as began since; wraps */
  int32_t gap;      /* q30: 0 is the low end of the model's range of gaps, 1.0 the high one */
  int32_t force;    /* q30 of the full-scale force */
  int32_t position; /* q31 of the controller's full scale, rising as the armature rises */
  int32_t current[PORT_CURRENTS]; /* q30 of the full-scale current: what flows at t_n */
  uint32_t status;                /* bits of PORT_..., or 0 */
} port_sample;

/* All functions are there; each is given the context. */
struct port {
  void *context; /* the board's own, for this controller */

  /* Fills the sample of the tick that began last. Called once by each app_tick. All values are of
     the same instant t_n. Must not wait: where a converter has not finished, that is
     PORT_NO_SAMPLE. */
  void (*sense)(void *context, port_sample *sample);

  /* The currents that shall flow from t_n+1 on, q31 of full scale, PORT_CURRENTS of them. Called
     once by each app_tick, also in the state fault. state is the state of the controller plus 256
     times the reason of a fault; a board may show it, and may switch its power stage off in fault
     once the currents are 0. */
  void (*drive)(void *context, const int32_t *currents, uint32_t state);

  /* Takes at most `most` bytes that arrived on the link, in order, and returns how many; 0 where
     there are none. Must not wait. A byte that the line knows to be broken (framing, overrun) may
     be dropped or passed on: the checksum finds it either way. */
  uint16_t (*link_read)(void *context, uint8_t *bytes, uint16_t most);

  /* Takes over up to `count` bytes for sending, in order, and returns how many. Must not wait; what
     it did not take is offered again. Taken means: sent later without further calls. */
  uint16_t (*link_write)(void *context, const uint8_t *bytes, uint16_t count);

  /* Between these two app_tick of this controller does not run. Called by app_poll for a few dozen
     instructions, never nested. Empty on a board that calls app_tick and app_poll in turn. */
  void (*lock)(void *context);
  void (*unlock)(void *context);

  /* Keeps a parameter block of so many words for the next start. Called by app_poll, without
     current; may take seconds, if in that time no tick begins. 1, or 0 where the board cannot or
     did not. */
  int (*keep)(void *context, const int16_t *block, uint16_t words);
};

static inline void port_lock(const struct port *port) { port->lock(port->context); }

static inline void port_unlock(const struct port *port) { port->unlock(port->context); }

#endif
