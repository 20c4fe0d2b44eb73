/* SPDX-License-Identifier: Apache-2.0 */
/* Power stage and current references by timer 1. The hardware switches them off without software.

       PA8  (D7)    power stage on (high)
       PA9  (D8)    reference of current 1: duty cycle of 40.5 kHz pulses
       PA10 (D2)    reference of current 2, likewise
       PB12 (CN10)  over-current, low: sets all three outputs low within a microsecond
       PB4  (D5)    emergency stop, high: closed
       PB5  (D4)    amplifier, high: ready

   The three inputs are pulled low, so that a broken wire is a fault. The emergency-stop contact
   must switch the supply of the stage; this input only reports it. */
#ifndef STAGE_H
#define STAGE_H

#include <stdint.h>

void power_stage_start(void);

/* Sets the references of both currents (q31), and switches the power stage on or off. If the
   hardware switched the outputs off, enables them again when both currents are zero and the
   over-current input is high. */
void power_stage_drive(const int32_t *currents, int on);

/* Returns the bits of port_sample.status. */
uint32_t power_stage_status(void);

/* Sets all outputs low immediately. */
void stage_panic(void);

#endif
