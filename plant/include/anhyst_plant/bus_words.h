/* SPDX-License-Identifier: Apache-2.0 */
/* What a virtual plant and a firmware tell each other at a tick, 32-bit words. Made by
   tools/contract from contract/frames.toml. */
/* clang-format off */
#ifndef ANHYST_PLANT_BUS_WORDS_H
#define ANHYST_PLANT_BUS_WORDS_H

#include <stdint.h>

/* Plant to controller: the sensor readings at the beginning of a tick. */
enum {
  ANHYST_BUS_SAMPLE_TICK, /* counts from 1 */
  ANHYST_BUS_SAMPLE_GAP, /* q30: 0 is the low end of the model's gaps, 1.0 the high one */
  ANHYST_BUS_SAMPLE_FORCE, /* q30 of the full-scale force */
  ANHYST_BUS_SAMPLE_POSITION, /* q31 of the position controller's full scale */
  ANHYST_BUS_SAMPLE_CURRENT, /* current of the first magnet, q30 of full scale */
  ANHYST_BUS_SAMPLE_CURRENT_2, /* current of the second magnet, q30 of full scale */
  ANHYST_BUS_SAMPLE_STATUS, /* bits of PORT_... in port/port.h */
  ANHYST_BUS_SAMPLE_WORDS
};

/* Controller to plant: the currents from the beginning of the next tick on, and signals of the
   controller for recordings. */
enum {
  ANHYST_BUS_DRIVE_TICK, /* tick of the sample from which the record was computed */
  ANHYST_BUS_DRIVE_DRIVE, /* commanded current of the first magnet, q31 of full scale */
  ANHYST_BUS_DRIVE_DRIVE_2, /* commanded current of the second magnet, q31 of full scale */
  ANHYST_BUS_DRIVE_STATE, /* state + 256*fault */
  ANHYST_BUS_DRIVE_MODE, /* flags + 65536*phase */
  ANHYST_BUS_DRIVE_DEMAND, /* active demand, q31 of the full-scale force */
  ANHYST_BUS_DRIVE_REFERENCE, /* reference position, q31 of the controller's full scale */
  ANHYST_BUS_DRIVE_FLUX, /* flux of the first magnet's model after the commit, q30 */
  ANHYST_BUS_DRIVE_EXPECTED, /* force of this model, q31 */
  ANHYST_BUS_DRIVE_WORDS
};

#endif
