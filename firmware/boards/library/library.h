/* SPDX-License-Identifier: Apache-2.0 */
/* Board as a shared library: controllers run in the program that simulates their plants. The bytes
   of the link are the same as on other boards; sample and drive have no checksum. Any number of
   controllers may run; each uses only its own memory, which the caller provides. A controller need
   not be closed. */
#ifndef ANHYST_LIBRARY_H
#define ANHYST_LIBRARY_H

#include <stddef.h>

#include "link/frames.h"

#define LIBRARY_EXPORT __attribute__((visibility("default")))

/* Returns the number of bytes of memory per controller. The memory must be aligned as by malloc. */
LIBRARY_EXPORT size_t library_bytes(void);

/* Starts a controller. The previous contents of the memory do not matter. */
LIBRARY_EXPORT void library_start(void *controller);

/* Runs a tick: reads a link_plant_sample and writes a link_plant_drive, both of 32-bit words. */
LIBRARY_EXPORT void library_tick(void *controller, const void *sample, void *drive);

/* Passes `count` bytes to the firmware, which reads all of them. Writes up to `size` sent bytes to
   `sent` and returns their number. If this is less than `size`, there are no more bytes now. */
LIBRARY_EXPORT uint16_t library_link(void *controller, const uint8_t *bytes, uint16_t count,
                                     uint8_t *sent, uint16_t size);

#endif
