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
  /* Head, the same in every kind. */
  ANHYST_WORD_MAGIC = 0, /* unsigned: marks the start of a block, two words */
  ANHYST_WORD_LAYOUT = 2, /* integer: of the words; the code must know it */
  ANHYST_WORD_KIND = 3, /* 1..5: 1 full, 2 simplified, 3 Euler, 4 cells, 5 play */
  ANHYST_WORD_LENGTH = 4, /* 64..2048: of the whole block, words (unsigned, up to 33474 in play) */
  ANHYST_WORD_GENERATION = 5, /* unsigned: chosen by whoever sends the block */
  ANHYST_WORD_CRC = 6, /* unsigned: CRC-32 of all other words, low half, high half */
  ANHYST_WORD_MODEL = 8, /* unsigned: first 32 bits of the model's hash, low half, high half */

  /* Demand to flux, the same in every kind. */
  /* 1..2: the output goes with this power of the flux (2: output is a force, flux is its root; 1:
     output is linear) */
  ANHYST_WORD_POWER = 10,
  ANHYST_WORD_DEMAND_LOW = 11, /* q15: smallest demand */
  ANHYST_WORD_DEMAND_HIGH = 12, /* q15: largest demand */
  ANHYST_WORD_CURRENT_LOW = 13, /* q15: smallest current */
  ANHYST_WORD_CURRENT_HIGH = 14, /* q15: largest current */
  ANHYST_WORD_CURRENT_SHIFT = 15, /* 0..8: 1.0 of the inner current is 2^this of full scale */
  ANHYST_WORD_FLUX_LIMIT = 16, /* q14: largest flux solved for, of that of saturated iron */
  ANHYST_WORD_FLUX_SHIFT = 17, /* 0..6: flux = root*gain*2^this */
  ANHYST_WORD_GAP_SEGMENTS = 18, /* 0..6: tables over the gap have 2^this segments */
  ANHYST_WORD_GAP_GAIN = 19, /* table, weight: flux at full-scale demand, over the gap */
  /* table, q15: output at zero flux (taken off the demand), over the gap */
  ANHYST_WORD_GAP_OFFSET = 20,
  ANHYST_WORD_GAP_BIAS = 21, /* table, weight: current at zero flux and zero field, over the gap */
  /* table, weight: current for a flux of 1.0 (below 0 in full and cells alone, where more field
     needs more current), over the gap */
  ANHYST_WORD_GAP_FLUX_ARM = 22,
  ANHYST_WORD_GAP_FIELD_ARM = 23, /* table, weight: current for a field of 1.0, over the gap */

  /* Start-up, the same in every kind. */
  /* 0..64: start-up: triangles of current (ramps up and down that make the state known) */
  ANHYST_WORD_CONDITION_CYCLES = 24,
  ANHYST_WORD_CONDITION_TICKS = 25, /* 2..32767: start-up: ticks of one ramp */

  /* The root of the demand, the same in every kind. */
  ANHYST_WORD_ROOT_KNEE = 26, /* 2..8: below 2^(-2*this) of full scale the root is straight */

  /* Full: the exact step. The field is in units of the largest one the tables reach, X. */
  ANHYST_WORD_FULL_AIR = 32, /* weight: flux of a field of 1.0 without iron (h*X/4) */
  ANHYST_WORD_FULL_REVERSIBLE = 33, /* q15: reversible fraction c */
  ANHYST_WORD_FULL_PLAY = 34, /* q15: half-width of the play, in fields of 1.0 */
  /* weight: octaves forgotten in a field of 1.0 (X/(kappa*ln 2), over 16*2^shift) */
  ANHYST_WORD_FULL_RATE = 35,
  ANHYST_WORD_FULL_RATE_SHIFT = 36, /* 0..12: exponent of the rate */
  /* q8: field of 1.0 over the pinning (X/kappa, or the largest q8: steers Newton's steps only) */
  ANHYST_WORD_FULL_STEEPNESS = 37,
  ANHYST_WORD_FULL_ITERATIONS = 38, /* 2..16: evaluations of a solve */
  ANHYST_WORD_FULL_CURVE_SEGMENTS = 39, /* 3..9: the curve has 2^this segments */
  ANHYST_WORD_FULL_CURVE = 40, /* table, q15: anhysteretic magnetisation, over the field */
  /* table, q15: ascending branch of the pinned part (2^(n+1) segments), over the field, both signs
     */
  ANHYST_WORD_FULL_BRANCH = 41,
  ANHYST_WORD_FULL_INVERSE_SEGMENTS = 42, /* 3..9: the inverse has 2^this segments */
  /* table, q15: field of an anhysteretic magnetisation, over the magnetisation */
  ANHYST_WORD_FULL_INVERSE = 43,

  /* Simplified (the closed form) and Euler (eqs. 13 to 15 with 19 and 20 of the paper). */
  ANHYST_WORD_SIMPLE_RATE = 32, /* weight: distance travelled for a flux of 1.0 (over 8*2^shift) */
  ANHYST_WORD_SIMPLE_RATE_SHIFT = 33, /* 0..12: exponent of the rate */
  /* weight: change of the bounded state for a flux of 1.0 while held (over 2^shift) */
  ANHYST_WORD_SIMPLE_HOLD = 34,
  ANHYST_WORD_SIMPLE_HOLD_SHIFT = 35, /* 0..12: exponent of the hold */
  ANHYST_WORD_SIMPLE_REST = 36, /* q15: 1 - nu of the closed form */
  ANHYST_WORD_SIMPLE_ITERATIONS = 37, /* 2..16: evaluations of a commit */

  /* Simplified only. */
  ANHYST_WORD_SIMPLE_OCTAVES = 38, /* 4..14: the curve reaches over so many octaves of distance */
  ANHYST_WORD_SIMPLE_SEGMENTS = 39, /* 2..6: 2^this segments in each octave */
  /* table, q15: bounded state 1 - v ((octaves + 1)*2^n segments, 2^n below the first octave), over
     the distance */
  ANHYST_WORD_SIMPLE_CURVE = 40,

  /* Euler only. */
  ANHYST_WORD_EULER_SUBSTEPS = 41, /* 1..16: explicit Euler steps a sample */

  /* Simplified and Euler: the dead band. The bounded state returns with the flux from such a
     reversal. */
  /* weight: largest reversal of the flux that does not begin a new path */
  ANHYST_WORD_SIMPLE_BAND = 42,

  /* Cells: plays in the effective field. The field is in units of the largest one the tables reach,
     X. */
  ANHYST_WORD_CELLS_AIR = 32, /* weight: flux of a field of 1.0 without iron (h*X/4) */
  ANHYST_WORD_CELLS_COUNT = 33, /* 1..12: plays, beside the one without width */
  /* 2..8: a row has 2^this segments on each side of zero up to the zone */
  ANHYST_WORD_CELLS_SEGMENTS = 34,
  /* 0..5: the zone ends at a field of 2^-this; beyond, segments are 2^this times as wide */
  ANHYST_WORD_CELLS_ZONE = 35,
  /* table, q15: half-widths of the plays, in fields of 1.0, rising, over the play */
  ANHYST_WORD_CELLS_THRESHOLDS = 36,
  /* table, q15: magnetisation of the plays that move (a row for 1, 2, .. count + 1 of them over
     fields of both signs), over the moving plays */
  ANHYST_WORD_CELLS_ROWS = 37,

  /* Solid iron: layers of the law with diffusion between them. A tick is a step of it. */
  ANHYST_WORD_SOLID_LAYERS = 38, /* 0..4: layers, 2 to 4; 0: thin iron, and 0 all that follows */
  /* weight: field from layer to layer for a flux of 1.0 more than a tick before */
  ANHYST_WORD_SOLID_HOLD = 39,
  ANHYST_WORD_SOLID_HOLD_SHIFT = 40, /* 0..15: exponent of it */
  /* weight: field of a flux of 1.0 in its layer, beside that of the law */
  ANHYST_WORD_SOLID_OWN = 41,
  ANHYST_WORD_SOLID_SURFACE = 42, /* q15: share of the first layer in the section */
  /* q15: share of the path in which the field is the same throughout */
  ANHYST_WORD_SOLID_LAMINATED = 43,

  /* Play: a map of the current with one play. Its block may have more words than the others. */
  /* q15: demand of the first column (below 0 in floating point only) */
  ANHYST_WORD_PLAY_DEMAND_LOW = 10,
  ANHYST_WORD_PLAY_CURRENT_LOW = 11, /* q15: lowest current */
  ANHYST_WORD_PLAY_CURRENT_HIGH = 12, /* q15: highest current */
  ANHYST_WORD_PLAY_FORCE_SEGMENTS = 13, /* 0..8: tables have 2^this segments along the demand */
  ANHYST_WORD_PLAY_GAP_SEGMENTS = 14, /* 0..6: tables have 2^this segments over the gap */
  ANHYST_WORD_PLAY_STEEPNESS = 15, /* weight: 1/(4*radius of the play), per current of 1.0 */
  ANHYST_WORD_PLAY_SHIFT = 16, /* 0..9: exponent of the steepness */
  ANHYST_WORD_PLAY_CURRENT = 17, /* table, q15: current without the play, over the demand and gap */
  ANHYST_WORD_PLAY_HALF = 18, /* table, q15: half-width of the loop, over the demand and gap */

  /* What the signals are counted in, the same in every kind. A board states the same words, and
     takes no block in which one of them is another. */
  ANHYST_WORD_SCALE_DEMAND = 48, /* single: demand of 1.0 */
  ANHYST_WORD_SCALE_CURRENT = 50, /* single: current of 1.0 */
  ANHYST_WORD_SCALE_GAP_LOW = 52, /* single: gap of 0 */
  ANHYST_WORD_SCALE_GAP_HIGH = 54, /* single: gap of 1.0 */
  ANHYST_WORD_SCALE_RATE = 56, /* single: ticks a second of the start-up */
  /* 0..32767: units of demand + 16*current + 256*gap (ANHYST_UNIT_...) */
  ANHYST_WORD_SCALE_UNITS = 58,

  /* What the memory is counted in, by which it is brought from one block to another; full and
     cells. */
  ANHYST_WORD_UNIT_FIELD = 60, /* single: field of a field of 1.0 */

  ANHYST_BLOCK_LEAST_WORDS = 64
};

#endif
