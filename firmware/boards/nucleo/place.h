/* SPDX-License-Identifier: Apache-2.0 */
/* Position sensor: the code of an incremental encoder or of a 16-bit ADC.

       PB6 (D10), PB7 (CN7)  encoder, lines A and B: timer 4 counts every edge
       PB10 (D6)             ADC: starts on the falling edge, PLACE_CONVERT_NS after the tick
       PB13 (CN10)           ADC: clock, 20.75 MHz; bits change on its rising edge
       PC2 (CN7)             ADC: data, 16 bits, most significant first, straight binary

   The timer of the tick starts the ADC, and DMA reads the result before the tick is computed; no
   instruction is involved. The encoder is read when the tick is computed: some microseconds later,
   plus the latency of the interrupt. */
#ifndef PLACE_H
#define PLACE_H

#include <stdint.h>

#define PLACE_ENCODER 0U
#define PLACE_CONVERTER 1U

/* Duration of the start pulse of the ADC, before its result is read. */
#define PLACE_CONVERT_NS 1000U

void place_start(void);

/* Returns the encoder edges since the start, modulo 2^32; at most 32767 between two calls. */
int32_t place_encoder(void);

/* Returns the code of the ADC at this tick, 0..65535; -1 if the ADC has not answered. */
int32_t place_converter(void);

#endif
