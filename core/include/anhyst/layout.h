/* SPDX-License-Identifier: Apache-2.0 */
/* Where what stands in a parameter block.

   A block is a row of 16-bit words without pointers, so that it can be stored, sent and swapped
   whole. Words are signed unless said otherwise; 32-bit numbers stand as low word, high word; a
   single is the 32 bits of an IEEE number of single precision, never computed with as such; a
   table is named by the number of its first word in the block. Interpolated tables have 2^n equal
   segments and so 2^n + 1 entries, neighbours of which differ by at most 32767. */
#ifndef ANHYST_LAYOUT_H
#define ANHYST_LAYOUT_H

#define ANHYST_BLOCK_MAGIC_LOW 0x6E41  /* "An" */
#define ANHYST_BLOCK_MAGIC_HIGH 0x7968 /* "hy" */
#define ANHYST_BLOCK_LAYOUT 2
#define ANHYST_BLOCK_MOST_WORDS 1024 /* 2 KiB */

/* Kinds of compensator. */
#define ANHYST_KIND_FULL 1
#define ANHYST_KIND_SIMPLIFIED 2
#define ANHYST_KIND_EULER 3

/* Units of the signals; 0: none. */
enum {
  ANHYST_UNIT_NUMBER = 1,
  ANHYST_UNIT_A = 2,
  ANHYST_UNIT_A_PER_M = 3,
  ANHYST_UNIT_V = 4,
  ANHYST_UNIT_N = 5,
  ANHYST_UNIT_T = 6,
  ANHYST_UNIT_WB = 7,
  ANHYST_UNIT_M = 8,
  ANHYST_UNIT_S = 9,
  ANHYST_UNIT_PA = 10,
  ANHYST_UNIT_HZ = 11,
  ANHYST_UNIT_RAD = 12,
  ANHYST_UNIT_DEGC = 13
};

#define ANHYST_SCALE_WORDS 11 /* from ANHYST_WORD_SCALE_DEMAND on */

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
  ANHYST_WORD_POWER = 10,         /* 2: output is a force, flux is its root; 1: output is linear */
  ANHYST_WORD_DEMAND_LOW = 11,    /* q15, limits of the demand */
  ANHYST_WORD_DEMAND_HIGH = 12,   /* q15 */
  ANHYST_WORD_CURRENT_LOW = 13,   /* q15, limits of the current */
  ANHYST_WORD_CURRENT_HIGH = 14,  /* q15 */
  ANHYST_WORD_CURRENT_SHIFT = 15, /* 1.0 of the inner current is 2^shift of full scale, 0..8 */
  ANHYST_WORD_FLUX_LIMIT = 16,    /* q14: largest |flux| solved for, at most 1 */
  ANHYST_WORD_FLUX_SHIFT = 17,    /* flux = root*gain*2^shift, 0..6 */
  ANHYST_WORD_GAP_SEGMENTS = 18,  /* n: each table over the gap has 2^n segments, 0..6 */
  ANHYST_WORD_GAP_GAIN = 19,      /* table: weight from root of the demand to flux */
  ANHYST_WORD_GAP_OFFSET = 20,    /* table: q15, output at zero flux, taken off the demand */
  ANHYST_WORD_GAP_BIAS = 21,      /* table: weight, current at zero flux and field */
  ANHYST_WORD_GAP_FLUX_ARM = 22,  /* table: weight, current for each unit of flux; below 0 in
                                     the full law alone, where more field needs more current */
  ANHYST_WORD_GAP_FIELD_ARM = 23, /* table: weight, current for each unit of field, > 0 */

  /* Start-up, the same in every kind. */
  ANHYST_WORD_CONDITION_CYCLES = 24, /* ramps up and down that make the state known */
  ANHYST_WORD_CONDITION_TICKS = 25,  /* ticks of one ramp, 2..32767 */

  ANHYST_WORD_ROOT_KNEE = 26, /* k: below 2^(-2k) of full scale the root is a straight line, 2..8 */

  /* 27..31 are zero; 32..47 belong to the kind. */

  /* Full: the exact step. The field is in units of the largest one the tables reach, X. */
  ANHYST_WORD_FULL_AIR = 32,        /* weight: quarter of the flux of a unit of field, h*X/4 */
  ANHYST_WORD_FULL_REVERSIBLE = 33, /* q15: c */
  ANHYST_WORD_FULL_PLAY = 34,       /* q15: half-width of the play */
  ANHYST_WORD_FULL_RATE = 35,       /* weight: octaves forgotten in a unit of field, X/(kappa*ln 2),
                                       over 16*2^shift */
  ANHYST_WORD_FULL_RATE_SHIFT = 36, /* 0..12 */
  ANHYST_WORD_FULL_STEEPNESS = 37,  /* q8: X/kappa, or the largest q8: steers Newton's steps only */
  ANHYST_WORD_FULL_ITERATIONS = 38, /* evaluations of a solve, 2..16 */
  ANHYST_WORD_FULL_CURVE_SEGMENTS = 39, /* n: 3..9, segments of the anhysteretic curve */
  ANHYST_WORD_FULL_CURVE = 40,          /* table: q15, anhysteretic curve over a field of 0..1 */
  ANHYST_WORD_FULL_BRANCH = 41, /* table of 2^(n+1) segments: q15, ascending branch, -1..1 */
  ANHYST_WORD_FULL_INVERSE_SEGMENTS = 42, /* n: 3..9 */
  ANHYST_WORD_FULL_INVERSE = 43,          /* table: q15, field over the anhysteretic, 0..1 */

  /* Simplified (the closed form) and Euler (eqs. 13 to 15 with 19 and 20 of the paper). */
  ANHYST_WORD_SIMPLE_RATE = 32,       /* weight: distance z of a unit of flux, over 8*2^shift */
  ANHYST_WORD_SIMPLE_RATE_SHIFT = 33, /* 0..12 */
  ANHYST_WORD_SIMPLE_HOLD = 34, /* weight: change of u of a unit of flux while held, over 2^shift */
  ANHYST_WORD_SIMPLE_HOLD_SHIFT = 35, /* 0..12 */
  ANHYST_WORD_SIMPLE_REST = 36,       /* q15: 1 - nu, above 0 */
  ANHYST_WORD_SIMPLE_ITERATIONS = 37, /* evaluations of a commit, 2..16 */
  ANHYST_WORD_SIMPLE_OCTAVES = 38,    /* 4..14; simplified only, as the next two */
  ANHYST_WORD_SIMPLE_SEGMENTS = 39,   /* n: 2..6, 2^n segments below the first octave and in each */
  ANHYST_WORD_SIMPLE_CURVE = 40,      /* table of (octaves + 1)*2^n segments: q15, 1 - v over z */
  ANHYST_WORD_EULER_SUBSTEPS = 41,    /* 1..16; Euler only */

  /* What the signals are counted in, the same in every kind. A board states the same words, and
     takes no block in which one of them is another. */
  ANHYST_WORD_SCALE_DEMAND = 48,   /* single: demand of 1.0, SI */
  ANHYST_WORD_SCALE_CURRENT = 50,  /* single: current of 1.0, SI */
  ANHYST_WORD_SCALE_GAP_LOW = 52,  /* single: gap of 0, SI */
  ANHYST_WORD_SCALE_GAP_HIGH = 54, /* single: gap of 1.0, SI */
  ANHYST_WORD_SCALE_RATE = 56,     /* single: ticks a second that the start-up is laid out for */
  ANHYST_WORD_SCALE_UNITS = 58,    /* of demand + 16*current + 256*gap: ANHYST_UNIT_... */

  /* What the memory is counted in, by which it is brought from one block to another. */
  ANHYST_WORD_UNIT_FIELD = 60, /* single: effective field of a field of 1.0, A/m; full only */

  /* 59, 62 and 63 are zero. */

  ANHYST_BLOCK_LEAST_WORDS = 64
};

#endif
