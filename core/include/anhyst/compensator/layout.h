/* SPDX-License-Identifier: Apache-2.0 */
/* Where what stands in a parameter block. Made by tools/contract from contract/block.toml.

   A block is a row of 16-bit words without pointers, so that it can be stored, sent and swapped
   whole. Words are signed unless said otherwise; 32-bit numbers stand as low word, high word; a
   single is the 32 bits of an IEEE number of single precision, never computed with as such; a
   table is named by the number of its first word in the block. Interpolated tables have 2^n equal
   segments and so 2^n + 1 entries, neighbours of which differ by at most 32767. Words that no line
   names are zero. */
/* clang-format off */
#ifndef ANHYST_LAYOUT_H
#define ANHYST_LAYOUT_H

#define ANHYST_BLOCK_MAGIC_LOW 0x6E41
#define ANHYST_BLOCK_MAGIC_HIGH 0x7968
#define ANHYST_BLOCK_LAYOUT 2
#define ANHYST_BLOCK_MOST_WORDS 2048
#define ANHYST_BLOCK_MOST_REAL_WORDS 1048576

/* Kinds of compensator. */
#define ANHYST_KIND_FULL 1
#define ANHYST_KIND_SIMPLIFIED 2
#define ANHYST_KIND_EULER 3
#define ANHYST_KIND_CELLS 4
#define ANHYST_KIND_PLAY 5

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
  /* Header, the same for every kind. */
  ANHYST_WORD_MAGIC = 0, /* unsigned: marks the start of a block, two words */
  ANHYST_WORD_LAYOUT = 2, /* integer: version of the layout; the code must support it */
  ANHYST_WORD_KIND = 3, /* 1..5: 1 full, 2 simplified, 3 Euler, 4 cells, 5 play */
  /* 64..2048: length of the whole block, words (unsigned, up to 33474 in play) */
  ANHYST_WORD_LENGTH = 4,
  ANHYST_WORD_GENERATION = 5, /* unsigned: number of the block, chosen by its sender */
  ANHYST_WORD_CRC = 6, /* unsigned: CRC-32 of all other words, low half, high half */
  ANHYST_WORD_MODEL = 8, /* unsigned: first 32 bits of the model's hash, low half, high half */

  /* From demand to flux, the same for every kind. */
  /* 1..2: exponent: the output is proportional to this power of the flux (2: the output is a force
     and the flux its root; 1: the output is linear) */
  ANHYST_WORD_POWER = 10,
  ANHYST_WORD_DEMAND_LOW = 11, /* q15: smallest demand */
  ANHYST_WORD_DEMAND_HIGH = 12, /* q15: largest demand */
  ANHYST_WORD_CURRENT_LOW = 13, /* q15: smallest current */
  ANHYST_WORD_CURRENT_HIGH = 14, /* q15: largest current */
  ANHYST_WORD_CURRENT_SHIFT = 15, /* 0..8: 1.0 of the internal current is 2^this times full scale */
  ANHYST_WORD_FLUX_LIMIT = 16, /* q14: largest flux of a solution, relative to saturated iron */
  ANHYST_WORD_FLUX_SHIFT = 17, /* 0..6: flux = root*gain*2^this */
  ANHYST_WORD_GAP_SEGMENTS = 18, /* 0..6: tables over the gap have 2^this segments */
  ANHYST_WORD_GAP_GAIN = 19, /* table, weight: flux at full-scale demand, over the gap */
  /* table, q15: output at zero flux (subtracted from the demand), over the gap */
  ANHYST_WORD_GAP_OFFSET = 20,
  ANHYST_WORD_GAP_BIAS = 21, /* table, weight: current at zero flux and zero field, over the gap */
  /* table, weight: current for a flux of 1.0 (negative only in full and cells, where a larger field
     needs a larger current), over the gap */
  ANHYST_WORD_GAP_FLUX_ARM = 22,
  ANHYST_WORD_GAP_FIELD_ARM = 23, /* table, weight: current for a field of 1.0, over the gap */

  /* Start-up, the same for every kind. */
  /* 0..64: start-up: number of current triangles (the triangles erase the unknown history) */
  ANHYST_WORD_CONDITION_CYCLES = 24,
  ANHYST_WORD_CONDITION_TICKS = 25, /* 2..32767: start-up: number of ticks of one ramp */

  /* The root of the demand, the same for every kind. */
  /* 2..8: below 2^(-2*this) of full scale, the root is a straight line */
  ANHYST_WORD_ROOT_KNEE = 26,

  /* A single eddy-current lag, the same for every kind. Each tick is one time step. */
  /* table, weight: current for a flux that rises by 1.0 per tick (0 instead of a table: no lag),
     over the gap */
  ANHYST_WORD_GAP_LAG_ARM = 27,

  /* Full: the exact step. The unit of the field is the largest field of the tables, X. */
  ANHYST_WORD_FULL_AIR = 32, /* weight: flux for a field of 1.0 without iron (h*X/4) */
  ANHYST_WORD_FULL_REVERSIBLE = 33, /* q15: reversible fraction c */
  ANHYST_WORD_FULL_PLAY = 34, /* q15: threshold of the play, in units of the field */
  /* weight: decay of the distance from the anhysteretic curve for a field change of 1.0, octaves
     (X/(kappa*ln 2), divided by 16*2^shift) */
  ANHYST_WORD_FULL_RATE = 35,
  ANHYST_WORD_FULL_RATE_SHIFT = 36, /* 0..12: exponent of the rate */
  /* q8: field of 1.0 divided by the pinning (X/kappa, limited to the largest q8: used only for the
     Newton steps) */
  ANHYST_WORD_FULL_STEEPNESS = 37,
  ANHYST_WORD_FULL_ITERATIONS = 38, /* 2..16: maximum number of evaluations of a solve */
  ANHYST_WORD_FULL_CURVE_SEGMENTS = 39, /* 3..9: the curve has 2^this segments */
  ANHYST_WORD_FULL_CURVE = 40, /* table, q15: anhysteretic magnetisation, over the field */
  /* table, q15: ascending branch of the pinned part (2^(n+1) segments), over the field, both signs
     */
  ANHYST_WORD_FULL_BRANCH = 41,
  ANHYST_WORD_FULL_INVERSE_SEGMENTS = 42, /* 3..9: the inverse has 2^this segments */
  /* table, q15: field for an anhysteretic magnetisation, over the magnetisation */
  ANHYST_WORD_FULL_INVERSE = 43,

  /* Simplified (the closed form) and Euler (eqs. 13 to 15 with 19 and 20 of the paper). */
  ANHYST_WORD_SIMPLE_RATE = 32, /* weight: travel for a flux of 1.0 (divided by 8*2^shift) */
  ANHYST_WORD_SIMPLE_RATE_SHIFT = 33, /* 0..12: exponent of the rate */
  /* weight: change of the bounded state for a flux change of 1.0, while the state is negative after
     a reversal (divided by 2^shift) */
  ANHYST_WORD_SIMPLE_HOLD = 34,
  ANHYST_WORD_SIMPLE_HOLD_SHIFT = 35, /* 0..12: exponent of the hold */
  ANHYST_WORD_SIMPLE_REST = 36, /* q15: 1 - nu of the closed form */
  ANHYST_WORD_SIMPLE_ITERATIONS = 37, /* 2..16: maximum number of evaluations of a commit */

  /* Simplified only. */
  ANHYST_WORD_SIMPLE_OCTAVES = 38, /* 4..14: number of octaves of distance that the curve covers */
  ANHYST_WORD_SIMPLE_SEGMENTS = 39, /* 2..6: 2^this segments in each octave */
  /* table, q15: bounded state 1 - v ((octaves + 1)*2^n segments, 2^n below the first octave), over
     the distance */
  ANHYST_WORD_SIMPLE_CURVE = 40,

  /* Euler only. */
  ANHYST_WORD_EULER_SUBSTEPS = 41, /* 1..16: number of explicit Euler steps per tick */

  /* Simplified and Euler: the dead band. A smaller reversal is reversible: the bounded state
     returns with the flux. */
  /* weight: largest reversal of the flux that does not start a new path */
  ANHYST_WORD_SIMPLE_BAND = 42,

  /* Cells: play operators in the effective field. The unit of the field is the largest field of the
     tables, X. */
  ANHYST_WORD_CELLS_AIR = 32, /* weight: flux for a field of 1.0 without iron (h*X/4) */
  ANHYST_WORD_CELLS_COUNT = 33, /* 1..12: number of plays, without the play of threshold 0 */
  /* 2..8: a row has 2^this segments on each side of zero, up to the end of the zone */
  ANHYST_WORD_CELLS_SEGMENTS = 34,
  /* 0..5: the zone ends at a field of 2^-this; outside it, segments are wider by a factor of 2^this
     */
  ANHYST_WORD_CELLS_ZONE = 35,
  /* table, q15: thresholds of the plays in units of the field, in ascending order, over the play */
  ANHYST_WORD_CELLS_THRESHOLDS = 36,
  /* table, q15: magnetisation of the moving plays (one row for each number of moving plays, 1 to
     count + 1, over fields of both signs), over the moving plays */
  ANHYST_WORD_CELLS_ROWS = 37,

  /* Solid core: layers of the law with diffusion between them. Each tick is one time step. */
  /* 0..4: number of layers, 2 to 4; 0: laminated core, and all further words are 0 */
  ANHYST_WORD_SOLID_LAYERS = 38,
  /* weight: difference of the field between two layers for a flux that rises by 1.0 per tick */
  ANHYST_WORD_SOLID_HOLD = 39,
  ANHYST_WORD_SOLID_HOLD_SHIFT = 40, /* 0..15: exponent of the hold */
  /* weight: field for a flux of 1.0 in its own layer, in addition to the field of the law */
  ANHYST_WORD_SOLID_OWN = 41,
  ANHYST_WORD_SOLID_SURFACE = 42, /* q15: fraction of the cross-section in the first layer */
  /* q15: fraction of the flux path in which the field is uniform */
  ANHYST_WORD_SOLID_LAMINATED = 43,

  /* Play: a map of the current with one play operator. Its block can be longer than the others. */
  /* q15: demand of the first column (negative in floating point only) */
  ANHYST_WORD_PLAY_DEMAND_LOW = 10,
  ANHYST_WORD_PLAY_CURRENT_LOW = 11, /* q15: lowest current */
  ANHYST_WORD_PLAY_CURRENT_HIGH = 12, /* q15: highest current */
  ANHYST_WORD_PLAY_FORCE_SEGMENTS = 13, /* 0..8: tables have 2^this segments along the demand */
  ANHYST_WORD_PLAY_GAP_SEGMENTS = 14, /* 0..6: tables have 2^this segments over the gap */
  ANHYST_WORD_PLAY_STEEPNESS = 15, /* weight: 1/(4*threshold of the play), for a current of 1.0 */
  ANHYST_WORD_PLAY_SHIFT = 16, /* 0..9: exponent of the steepness */
  ANHYST_WORD_PLAY_CURRENT = 17, /* table, q15: current without the play, over the demand and gap */
  ANHYST_WORD_PLAY_HALF = 18, /* table, q15: half of the loop's width, over the demand and gap */

  /* Scales of the signals, the same for every kind. A board has the same words and rejects a block
     with a different one. */
  ANHYST_WORD_SCALE_DEMAND = 48, /* single: demand at 1.0 */
  ANHYST_WORD_SCALE_CURRENT = 50, /* single: current at 1.0 */
  ANHYST_WORD_SCALE_GAP_LOW = 52, /* single: gap at 0 */
  ANHYST_WORD_SCALE_GAP_HIGH = 54, /* single: gap at 1.0 */
  ANHYST_WORD_SCALE_RATE = 56, /* single: tick rate of the start-up */
  /* 0..32767: codes of the units: demand + 16*current + 256*gap (ANHYST_UNIT_...) */
  ANHYST_WORD_SCALE_UNITS = 58,

  /* Unit of the hysteresis state, for its transfer between blocks; full and cells. */
  ANHYST_WORD_UNIT_FIELD = 60, /* single: field at 1.0 */

  ANHYST_BLOCK_LEAST_WORDS = 64
};

#endif
