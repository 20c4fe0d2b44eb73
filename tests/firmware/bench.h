/* SPDX-License-Identifier: Apache-2.0 */
/* A test bench around the firmware: the test plays sensors, wire and clock of a board. */
#ifndef TEST_BENCH_H
#define TEST_BENCH_H

#include "app/app.h"
#include "fake_compensator.h"
#include "force/force.h"

#define BENCH_WORDS 64
#define BENCH_RATE 1000
#define BENCH_SESSION 1

typedef struct {
  app firmware;
  port_sample sample;   /* sensor values of the next tick */
  int32_t drive;        /* last driven current, q31 */
  uint32_t drive_state; /* controller state that was passed with the current */
  uint8_t wire[2048];   /* bytes on the way to the firmware */
  uint16_t wire_count;
  uint16_t wire_index;
  uint16_t max_accepted_bytes; /* bytes that the port accepts in one call */
  link_receiver receiver;
  link_frame answer; /* last answer of the firmware */
  uint8_t payload[LINK_MAX_PAYLOAD];
  int answers;
  int locks;        /* nesting depth of the locks */
  int locked_calls; /* number of locks */
  int refuses_to_keep;
  const int16_t *kept; /* block that the firmware asked the board to store */
  uint16_t kept_words;
} bench_board;

extern bench_board bench;
extern app_limits bench_limits;
extern int16_t bench_words[BENCH_WORDS];

/* Starts a new bench: firmware started, sensors in the middle of their range, no byte on the wire,
   and BENCH_SESSION open. The hello had the number 255, so that requests begin with number 0. */
void bench_start(void);

/* Starts a new bench without the hello. */
void bench_power_on(void);

/* Switches the power off and on. Only the firmware starts again. */
void bench_restart(void);

/* Sends a hello with this sequence number. Returns the type of the answer. */
uint8_t bench_hello(uint8_t sequence, uint16_t version, uint32_t session);

/* Runs `count` ticks with a little noise on the sensors. */
void bench_ticks(int count);

/* Increments the tick number of the sample and runs one tick with it. */
void bench_tick(void);

/* Puts a frame on the wire. Returns its number of bytes. */
uint16_t bench_put_frame(uint8_t type, uint8_t sequence, const uint8_t *payload, uint8_t length);

/* Polls the firmware until the wire is empty and every request has an answer. */
void bench_poll(void);

/* Sends a request with the next sequence number. Returns the type of its answer. */
uint8_t bench_request(uint8_t type, const uint8_t *payload, uint8_t length);

/* Send one kind of request each. */
uint8_t bench_command(uint16_t command);
uint8_t bench_demand(int32_t force);
uint8_t bench_set(uint16_t setting, int32_t value);

/* Return a field of the last answer. */
uint16_t bench_reason(void); /* reason of a NAK, otherwise LINK_REASON_NONE */
uint16_t bench_detail(void); /* detail of an ACK or a NAK */
uint16_t bench_state(void);  /* state from the answer to a heartbeat */

/* Leads the controller from the start through self-test and arm to run. */
void bench_run(void);

#endif
