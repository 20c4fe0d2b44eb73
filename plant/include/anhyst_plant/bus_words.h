/* SPDX-License-Identifier: Apache-2.0 */
/* What a virtual plant and a firmware tell each other at a tick, 32-bit words. Made by
   tools/contract from contract/frames.toml. */
/* clang-format off */
#ifndef ANHYST_PLANT_BUS_WORDS_H
#define ANHYST_PLANT_BUS_WORDS_H

#include <stdint.h>

/* Plant to controller: what the sensors show at the beginning of a tick. */
enum {
  ANHYST_BUS_SAMPLE_TICK, /* counts from 1 */
  ANHYST_BUS_SAMPLE_GAP, /* q30: 0 is the low end of the model's gaps, 1.0 the high one */
  ANHYST_BUS_SAMPLE_FORCE, /* q30 of the full-scale force */
  ANHYST_BUS_SAMPLE_POSITION, /* q31 of the controller's full scale */
  ANHYST_BUS_SAMPLE_CURRENT, /* q30 of the full-scale current, of the first magnet */
  ANHYST_BUS_SAMPLE_CURRENT_2, /* of the second */
  ANHYST_BUS_SAMPLE_STATUS, /* bits of PORT_... in port/port.h */
  ANHYST_BUS_SAMPLE_WORDS
};

/* Controller to plant: what is to flow from the beginning of the next tick on. Then signals that a
   plant does not know by itself. */
enum {
  ANHYST_BUS_DRIVE_TICK, /* of the sample from which this was computed */
  ANHYST_BUS_DRIVE_DRIVE, /* q31 of the full-scale current, of the first magnet */
  ANHYST_BUS_DRIVE_DRIVE_2, /* of the second */
  ANHYST_BUS_DRIVE_STATE, /* state + 256*fault */
  ANHYST_BUS_DRIVE_MODE, /* flags + 65536*phase */
  ANHYST_BUS_DRIVE_DEMAND, /* demand in force, q31 of the full-scale force */
  ANHYST_BUS_DRIVE_REFERENCE, /* position controlled to, q31 of the controller's full scale */
  ANHYST_BUS_DRIVE_FLUX, /* flux of the model of the first magnet after the commit, q30 */
  ANHYST_BUS_DRIVE_EXPECTED, /* force that this model expects, q31 */
  ANHYST_BUS_DRIVE_WORDS
};

#endif
