/* SPDX-License-Identifier: Apache-2.0 */
/* The board that is a shared library: the firmware within the program that steps the plant, without
   a process and a socket between them. Bytes of the link and records of the plant bus are those of
   the other boards. One firmware for each loaded copy of the file; it is on from library_start
   until the copy is unloaded. */
#ifndef ANHYST_LIBRARY_H
#define ANHYST_LIBRARY_H

#include <stdint.h>

#define LIBRARY_SHOWN __attribute__((visibility("default")))

/* Power on. Once, first. */
LIBRARY_SHOWN void library_start(void);

/* A tick: takes a record of LINK_SIZE_PLANT_SAMPLE bytes and gives one of LINK_SIZE_PLANT_DRIVE. A
   sample that is not valid leaves drive as it is, and no tick passes. */
LIBRARY_SHOWN void library_tick(const uint8_t *sample, uint8_t *drive);

/* Bytes to the link, all of which are read, and at most `most` of those that the firmware says,
   whose number is returned; it has no more to say now if that is less than `most`. */
LIBRARY_SHOWN uint16_t library_link(const uint8_t *bytes, uint16_t count, uint8_t *said,
                                    uint16_t most);

#endif
