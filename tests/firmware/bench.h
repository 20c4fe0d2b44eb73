/* SPDX-License-Identifier: Apache-2.0 */
/* A board on the bench: the test is its sensors, its wire and its clock. */
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
  port_sample sample;   /* what the sensors show next */
  int32_t drive;        /* last driven */
  uint32_t drive_state; /* told with it */
  uint8_t wire[2048];   /* to the firmware */
  uint16_t wire_count;
  uint16_t wire_at;
  uint16_t accepts; /* bytes that the port takes in one call */
  link_receiver receiver;
  link_frame answer; /* the last one */
  uint8_t payload[LINK_PAYLOAD_MOST];
  int answers;
  int locks;        /* depth */
  int locked_calls; /* how often */
  int refuses_to_keep;
  const int16_t *kept; /* block that was to be kept */
  uint16_t kept_words;
} bench_board;

extern bench_board bench;
extern app_limits bench_limits;
extern int16_t bench_words[BENCH_WORDS];

/* Everything new: firmware started, sensors in the middle of their range, nothing on the wire, and
   BENCH_SESSION open: the hello had the number 255, so that requests begin with 0. */
void bench_start(void);

/* The same before the hello. */
void bench_power_on(void);

/* Power off and on: the firmware alone begins anew. */
void bench_restart(void);

/* A hello with this sequence number; the type of the answer. */
uint8_t bench_hello(uint8_t sequence, uint16_t version, uint32_t session);

/* So many ticks with sensors that show a little noise. */
void bench_ticks(int count);

/* One tick with the sample as it stands, after its number was raised by one. */
void bench_tick(void);

/* Puts a frame on the wire; returns its bytes there. */
uint16_t bench_put(uint8_t type, uint8_t sequence, const uint8_t *payload, uint8_t length);

/* Lets the firmware poll until the wire is empty and everything is answered. */
void bench_poll(void);

/* A request with the next sequence number, answered: the type of the answer. */
uint8_t bench_ask(uint8_t type, const uint8_t *payload, uint8_t length);

/* Requests by name. */
uint8_t bench_command(uint16_t command);
uint8_t bench_demand(int32_t force);
uint8_t bench_set(uint16_t setting, int32_t value);

/* What the last answer says. */
uint16_t bench_reason(void); /* of a NAK, else LINK_REASON_NONE */
uint16_t bench_detail(void); /* of an ACK or a NAK */
uint16_t bench_state(void);  /* from a heartbeat */

/* From the start through self-test, arm and run. */
void bench_run(void);

#endif
