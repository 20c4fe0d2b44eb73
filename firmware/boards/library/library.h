/* SPDX-License-Identifier: Apache-2.0 */
/* The board that is a shared library: controllers within the program that steps their plants. The
   bytes of the link are those of the other boards; sample and drive of a tick go as they are,
   without the check of a bus. Any number of controllers, each in memory of the caller's that nobody
   else touches; they share nothing, and need not be ended. */
#ifndef ANHYST_LIBRARY_H
#define ANHYST_LIBRARY_H

#include <stddef.h>

#include "link/frames.h"

#define LIBRARY_SHOWN __attribute__((visibility("default")))

/* Bytes that a controller takes, aligned as malloc does. */
LIBRARY_SHOWN size_t library_bytes(void);

/* Power on: whatever was there before is forgotten. */
LIBRARY_SHOWN void library_start(void *controller);

/* A tick: from a link_plant_sample to a link_plant_drive, 32-bit words both. */
LIBRARY_SHOWN void library_tick(void *controller, const void *sample, void *drive);

/* Bytes to the link, all of which are read, and at most `most` of those that the firmware says,
   whose number is returned; it has no more to say now if that is less than `most`. */
LIBRARY_SHOWN uint16_t library_link(void *controller, const uint8_t *bytes, uint16_t count,
                                    uint8_t *said, uint16_t most);

#endif
