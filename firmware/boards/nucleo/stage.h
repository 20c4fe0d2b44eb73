/* SPDX-License-Identifier: Apache-2.0 */
/* Timer 1: power stage and current references as pulses, all cut by the hardware itself.

     PA8  (D7)    power stage on (high)
     PA9  (D8)    reference of current 1, pulses of 40.5 kHz: the share that it is high
     PA10 (D2)    reference of current 2, likewise
     PB12 (CN10)  over-current, low: takes all three low within a microsecond, without software
     PB4  (D5)    emergency stop, high: closed
     PB5  (D4)    amplifier, high: ready

   The three inputs are pulled low here, so that a broken wire is a fault. The contact of the
   emergency stop belongs into the supply of the stage; this input only reports. */
#ifndef STAGE_H
#define STAGE_H

#include <stdint.h>

void stage_start(void);

/* References of both currents, q31, and whether the stage is on. Once both are zero and the
   over-current is gone, what the hardware cut works again. */
void stage_drive(const int32_t *currents, int on);

/* Bits of port_sample.status. */
uint32_t stage_status(void);

/* Everything low at once. */
void stage_panic(void);

#endif
