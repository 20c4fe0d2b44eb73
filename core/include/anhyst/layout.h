/* SPDX-License-Identifier: Apache-2.0 */
/* Where what stands in a parameter block.

   A block is a row of 16-bit words without pointers, so that it can be stored, sent and swapped
   whole. Words are signed unless said otherwise; 32-bit numbers stand as low word, high word; a
   table is named by the number of its first word in the block. Interpolated tables have 2^n equal
   segments and so 2^n + 1 entries, neighbours of which differ by at most 32767. */
#ifndef ANHYST_LAYOUT_H
#define ANHYST_LAYOUT_H

#define ANHYST_BLOCK_MAGIC_LOW 0x6E41  /* "An" */
#define ANHYST_BLOCK_MAGIC_HIGH 0x7968 /* "hy" */
#define ANHYST_BLOCK_LAYOUT 1
#define ANHYST_BLOCK_MOST_WORDS 1024 /* 2 KiB */
#define ANHYST_CURVE_FIRST_OCTAVE 16 /* highest power of two of the curve's octaves */

/* Kinds of compensator. */
#define ANHYST_KIND_FULL 1
#define ANHYST_KIND_SIMPLIFIED 2
#define ANHYST_KIND_EULER 3

enum {
  /* Head, the same in every kind. */
  ANHYST_WORD_MAGIC = 0, /* two words */
  ANHYST_WORD_LAYOUT = 2,
  ANHYST_WORD_KIND = 3,
  ANHYST_WORD_LENGTH = 4,     /* of the whole block, words */
  ANHYST_WORD_GENERATION = 5, /* unsigned, chosen by whoever sends the block */
  ANHYST_WORD_CRC = 6,        /* two words: CRC-32 of all other words, low byte first */
  ANHYST_WORD_MODEL = 8,      /* two words: first 32 bits of the model's hash */

  /* Demand to flux, the same in every kind. */
  ANHYST_WORD_POWER = 10,        /* 2: output is a force, flux is its root; 1: output is linear */
  ANHYST_WORD_DEMAND_LOW = 11,   /* q15, limits of the demand */
  ANHYST_WORD_DEMAND_HIGH = 12,  /* q15 */
  ANHYST_WORD_CURRENT_LOW = 13,  /* q15, limits of the current */
  ANHYST_WORD_CURRENT_HIGH = 14, /* q15 */
  ANHYST_WORD_CURRENT_SHIFT = 15, /* 1.0 of the inner current is 2^shift of full scale, 0..8 */
  ANHYST_WORD_FLUX_LIMIT = 16,    /* q14: largest |flux| solved for, at most 1.5 */
  ANHYST_WORD_FLUX_SHIFT = 17,    /* flux = root*gain*2^shift, 0..6 */
  ANHYST_WORD_GAP_SEGMENTS = 18,  /* n: each table over the gap has 2^n segments, 0..6 */
  ANHYST_WORD_GAP_GAIN = 19,      /* table: weight from root of the demand to flux */
  ANHYST_WORD_GAP_OFFSET = 20,    /* table: q15, output at zero flux, taken off the demand */
  ANHYST_WORD_GAP_BIAS = 21,      /* table: weight, current at zero flux and field */
  ANHYST_WORD_GAP_FLUX_ARM = 22,  /* table: weight, current for each unit of flux, >= 0 */
  ANHYST_WORD_GAP_FIELD_ARM = 23, /* table: weight, current for each unit of field, > 0 */

  /* Start-up, the same in every kind. */
  ANHYST_WORD_CONDITION_CYCLES = 24, /* ramps up and down that make the state known */
  ANHYST_WORD_CONDITION_TICKS = 25,  /* ticks of one ramp, 2..32767 */

  ANHYST_WORD_KIND_FIRST = 32, /* words below are of one kind each; 26..31 are zero */

  /* Full: the exact step. */
  ANHYST_WORD_FULL_AIR = 32,       /* weight: quarter of flux for each unit of field (h*X/4) */
  ANHYST_WORD_FULL_REVERSIBLE = 33, /* weight: c/2 */
  ANHYST_WORD_FULL_PLAY = 34,       /* q15: half-width of the play in units of field */
  ANHYST_WORD_FULL_RATE = 35,       /* q8: X/(kappa*ln 2), octaves of forgetting a unit of field */
  ANHYST_WORD_FULL_ITERATIONS = 36, /* evaluations of a solve, 2..16 */
  ANHYST_WORD_FULL_CURVE_SEGMENTS = 37, /* n: anhysteretic, 2^n segments over 0..1 of the field */
  ANHYST_WORD_FULL_CURVE = 38,          /* table: q15 */
  ANHYST_WORD_FULL_BRANCH = 39,         /* table: q15, ascending branch, 2^(n+1) segments, -1..1 */
  ANHYST_WORD_FULL_INVERSE_SEGMENTS = 40, /* n: inverse of the anhysteretic, 2^n segments, 0..1 */
  ANHYST_WORD_FULL_INVERSE = 41,          /* table: q15 */

  /* Simplified: the closed form. */
  ANHYST_WORD_SIMPLE_RATE = 32,       /* q8: distance z for each unit of flux */
  ANHYST_WORD_SIMPLE_HOLD = 33,       /* q12: 1/(1 - nu) */
  ANHYST_WORD_SIMPLE_ITERATIONS = 34, /* evaluations of a commit, 2..16 */
  ANHYST_WORD_SIMPLE_OCTAVES = 35,    /* octaves of z in the table */
  ANHYST_WORD_SIMPLE_SEGMENTS = 36,   /* n: 2^n segments in each octave */
  ANHYST_WORD_SIMPLE_CURVE = 37,      /* table: q15, v over z */

  /* Euler: eqs. 13 to 15 of the paper with eqs. 19 and 20. */
  ANHYST_WORD_EULER_SUBSTEPS = 32,

  ANHYST_BLOCK_LEAST_WORDS = 48
};

#endif
