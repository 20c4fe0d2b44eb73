/* SPDX-License-Identifier: Apache-2.0 */
/* Firmware on a board without hardware: a virtual plant gives the ticks. A tick begins when the
   plant's sample has received_count, and ends when the drive has been sent. Virtual time stands
   still while plant or controller computes. This is the complete port except the functions of the
   link; link/frames.h defines the records. */
#ifndef LOCKSTEP_H
#define LOCKSTEP_H

#include <stdint.h>

#include "app/app.h"
#include BOARD_BODY /* force/force.h or position/position.h */

/* A controller with its end of the plant's bus. A board with additional state starts its own struct
   with this struct, because the context of the port is its address. */
typedef struct {
  app firmware;
  app_body body;
  struct port port;
  link_plant_sample sample;                 /* sample of the last tick */
  link_plant_drive drive;                   /* drive of the last tick */
  uint8_t arriving[LINK_SIZE_PLANT_SAMPLE]; /* received part of a record */
  uint16_t received_count;
} lockstep;

/* Constants of the board; board_force.c or board_position.c. */
extern const app_board lockstep_board;

/* Starts a controller with link functions of the board. */
void lockstep_start(lockstep *l,
                    uint16_t (*link_read)(void *context, uint8_t *bytes, uint16_t size),
                    uint16_t (*link_write)(void *context, const uint8_t *bytes, uint16_t count));

/* Runs the tick of l->sample and writes l->drive. */
void lockstep_tick(lockstep *l);

/* Processes a byte of the plant. When it completes a valid record, runs the tick, writes the answer
   of LINK_SIZE_PLANT_DRIVE bytes and returns 1; else returns 0. After lost bytes, the board
   synchronises to the next valid record. */
int lockstep_receive(lockstep *l, uint8_t byte, uint8_t *answer);

#endif
