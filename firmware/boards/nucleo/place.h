/* SPDX-License-Identifier: Apache-2.0 */
/* Where the armature is, as a code: of an incremental encoder, or of a converter of 16 bits.

     PB6 (D10), PB7 (CN7)  encoder, lines A and B: timer 4 counts every edge
     PB10 (D6)             converter: starts on the falling edge, PLACE_CONVERT_NS after the tick
     PB13 (CN10)           converter: clock, 20.75 MHz; bits change on its rising edge
     PC2 (CN7)             converter: data, 16 bits, most significant first, straight binary

   The converter is started by the timer of the tick, and what it found is fetched by DMA, before
   the tick is computed: no instruction lies between. The encoder's count is read when the tick is
   computed, some microseconds later, and as much later as an interrupt may be. */
#ifndef PLACE_H
#define PLACE_H

#include <stdint.h>

#define PLACE_ENCODER 0U
#define PLACE_CONVERTER 1U

/* Time for which the converter is commanded to convert, before it is read. */
#define PLACE_CONVERT_NS 1000U

void place_start(void);

/* Edges counted since the start, modulo 2^32; at most 32767 from one tick to the next. */
int32_t place_encoder(void);

/* What the converter found at this tick, 0..65535; -1 where it has not answered. */
int32_t place_converter(void);

#endif
