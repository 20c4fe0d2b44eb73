/* SPDX-License-Identifier: Apache-2.0 */
/* Position sensor: the code of an incremental encoder or of a 16-bit ADC.

       PB6 (D10), PB7 (CN7)  encoder, lines A and B: timer 4 counts every edge
       PB10 (D6)             ADC: starts on the falling edge, POSITION_CONVERSION_NS after the tick
       PB13 (CN10)           ADC: clock, 20.75 MHz; bits change on its rising edge
       PC2 (CN7)             ADC: data, 16 bits, most significant first, straight binary

   The timer of the tick starts the ADC, and DMA reads the result before the tick is computed; no
   instruction is involved. The encoder is read when the tick is computed: some microseconds later,
   plus the latency of the interrupt. */
#ifndef PLACE_H
#define PLACE_H

#include <stdint.h>

#define POSITION_FROM_ENCODER 0U
#define POSITION_FROM_CONVERTER 1U

/* Duration of the start pulse of the ADC, before its result is read. */
#define POSITION_CONVERSION_NS 1000U

void position_input_start(void);

/* Returns the encoder edges since the start, modulo 2^32; at most 32767 between two calls. */
int32_t read_encoder_position(void);

/* Returns the code of the ADC at this tick, 0..65535; -1 if the ADC has not answered. */
int32_t read_converter_position(void);

#endif
