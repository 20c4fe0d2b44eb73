/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator of a controller: wanted output (force) in, current out, in fixed point.

   At every tick: solve once or more, limit and apply the current, then commit what was really
   applied. solve does not touch the memory of the iron; commit advances it.

     flux    = gain(gap)*root(demand - offset(gap))
     field   = law(memory, flux)
     current = bias(gap) + flux_arm(gap)*flux + field_arm(gap)*field

   Signals, all dimensionless: a demand of 1.0 is the full-scale output, a current of 1.0 the
   full-scale current, a gap of 0 .. 1.0 the range of gaps (manifest.json states the scales). The
   _q15 and _q31 functions differ in these signals alone; inside all state is 32 bits wide.
   Nothing here allocates, waits, or loops a number of times that depends on data. */
#ifndef ANHYST_COMPENSATOR_H
#define ANHYST_COMPENSATOR_H

#include "anhyst/numeric/fixed.h"
#include "anhyst/compensator/flags.h"
#include "anhyst/compensator/layout.h"
#include "anhyst/compensator/plays.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What the iron remembers, all q30 within -1..1 unless the kernel says otherwise. Zero is the
   demagnetised state. From where the play last turned all is computed as long as the direction
   stays, so that steps far below a unit in the last place add up to nothing but themselves. */
typedef struct {
  int32_t x;     /* full, cells: field; simplified, euler: flux */
  int32_t y;     /* full: irreversible magnetisation; simplified, euler: bounded state u; cells:
                    magnetisation of the plays that rest */
  int32_t p;     /* full: play; simplified: distance z from where u was zero (q27 within -16..16,
                    signed as the direction; zero: unknown or held); cells: how many of them move,
                    below 0 where the field falls; zero: y is not known */
  int32_t turn;  /* full: play where it last turned; cells: bit i is set where play i came to rest
                    while the field rose */
  int32_t level; /* full: y there; cells: field, in its direction, where the last one joined */
} anhyst_memory;

/* Where a step leads that was solved last, and what a current or a flux near it needs. */
typedef struct {
  anhyst_memory memory;
  int32_t m;       /* full: magnetisation there, q28; simplified: z at the start, in its direction;
                      cells: field where the next play joins, in the direction */
  int32_t flux;    /* cells: h*x + m where the segment of the row begins, over 4 */
  int16_t way;     /* 1: the field rises, -1: it falls, 0: it stays, or not known */
  int16_t y_slope; /* full: of the irreversible part over the field, in 1/1024; cells: word of the
                      block where the segment begins */
  int16_t m_slope; /* full: of the magnetisation; cells: what the row rises on the segment */
  uint16_t fine;   /* cells: a part of 2^-15 of it is 2^this, q30; 0: nothing is known */
} anhyst_candidate;

/* How the current is made up at the gap of this tick. */
typedef struct {
  int32_t bias;      /* q30 */
  int16_t flux_arm;  /* weight; >= 0 but for the full law */
  int16_t field_arm; /* weight, > 0 */
} anhyst_arms;

struct anhyst_compensator;

/* A law in fixed point: all that a compensator asks of one. */
typedef struct anhyst_kernel {
  uint16_t kind; /* of the blocks it works with */
  /* The field that belongs to the flux of the compensator, q30, and in next where it leads; memory
     and plays stay. |flux| <= 1. next is what led to the memory, or its fine is 0. */
  int32_t (*field)(struct anhyst_compensator *c);
  /* The flux to which a current leads at its arms, q30: bias + flux_arm*flux + field_arm*field =
     current. next is what field() found from the same memory, or its way is 0: a current near that
     one is found in a fraction of the time. Afterwards its memory is what was reached. */
  int32_t (*flux)(struct anhyst_compensator *c, int32_t current);
  /* Whether a block's words of this kind are valid. */
  int (*valid)(const int16_t *words);
  /* Brings what is remembered from its block to another valid one, under which the iron stands at
     this flux, q30. |flux| <= 1. */
  void (*carry)(struct anhyst_compensator *c, const int16_t *words, int32_t flux);
  /* Takes over what the step to next leaves elsewhere than in the memory; 0: nothing. */
  void (*keep)(struct anhyst_compensator *c);
  /* Completes a memory of zeros by what a block says of a demagnetised iron; 0: it is complete. */
  void (*start)(struct anhyst_compensator *c);
  /* The kernel for a valid block of this kind; 0: this one. */
  const struct anhyst_kernel *(*for_block)(const int16_t *words);
} anhyst_kernel;

extern const anhyst_kernel anhyst_kernel_full;
extern const anhyst_kernel anhyst_kernel_simplified;
extern const anhyst_kernel anhyst_kernel_euler;
extern const anhyst_kernel anhyst_kernel_cells;

#if ANHYST_MEMORIES > 1
/* A layer of solid iron below the surface, or what is laminated. */
typedef struct {
  anhyst_memory memory;
  int32_t plays[ANHYST_CELLS];
  anhyst_candidate next;
  int32_t owed; /* flux that diffusion has let into it and deeper beyond what is there, q30 */
  int32_t next_owed;
  int32_t before; /* flux in it and deeper that the tick which was solved last set out from, q30 */
  int32_t stiffness; /* of next: slope of its field over that flux, 16 bits behind the point */
} anhyst_deeper;
#endif

/* One compensator: 140 bytes or fewer on targets with 32-bit pointers, for thin iron. */
typedef struct anhyst_compensator {
  const anhyst_kernel *kernel;
  const int16_t *words;        /* the parameter block in use; read only */
  anhyst_memory memory;        /* of what was applied */
  int32_t plays[ANHYST_CELLS]; /* law of cells: where they rest, q30 */
  anhyst_candidate next;       /* where the solved current would lead, or the last one led */
  anhyst_arms arms;            /* at the gap for which was solved */
  int32_t current;             /* solved, q31 */
  int32_t flux;                /* solved, q30 */
  int32_t flux_applied;        /* after the last commit, q30 */
  int32_t gap;                 /* for which was solved, q31 */
  uint16_t flags;              /* of the last solve, see flags.h */
  uint16_t solved;             /* whether next and arms belong to memory, gap and words */
#if ANHYST_MEMORIES > 1
  anhyst_deeper deeper[ANHYST_MEMORIES - 1];
#endif
} anhyst_compensator;

/* Starts with the demagnetised state. ANHYST_OK, or ANHYST_BAD_PARAMETER where the block is not
   valid: magic, layout, kind, length within capacity (words), checksum, every range and every
   table. Nothing is changed then. */
anhyst_status anhyst_compensator_init(anhyst_compensator *c, const anhyst_kernel *kernel,
                                      const int16_t *words, uint16_t capacity);

/* Takes the iron for demagnetised from now on. */
void anhyst_compensator_demagnetise(anhyst_compensator *c);

/* Whether a block is valid and of this kind: ANHYST_OK or ANHYST_BAD_PARAMETER. Reads at most
   capacity words. Takes about 100 instructions a word (checksum); not for an interrupt. */
anhyst_status anhyst_block_check(const anhyst_kernel *kernel, const int16_t *words,
                                 uint16_t capacity);

/* Whether a valid block is made for the signals there are: 0, or the place of the first number that
   is another one in the block. scales: full scales, range of the gap, ticks a second and units, as
   ANHYST_SCALE_WORDS words of a block from ANHYST_WORD_SCALE_DEMAND on. */
uint16_t anhyst_block_misfit(const int16_t *words, const int16_t *scales);

/* Goes on with another block, which must have passed anhyst_block_check for the same kernel and
   anhyst_block_misfit. The memory is brought to it: the output stays what it was, and so does how
   far the iron is behind its anhysteretic (simplified and Euler: the bounded state); fields are
   counted in its unit, and what is beyond its reach saturates. At an unchanged demand the current
   moves by what the two models differ. A block of another kind needs an init, and the iron a new
   start-up. Between two ticks; costs about as much as a solve. */
void anhyst_compensator_swap(anhyst_compensator *c, const int16_t *words);

/* The current that gives the demanded output now. */
int16_t anhyst_compensator_solve_q15(anhyst_compensator *c, int16_t demand, int16_t gap);
int32_t anhyst_compensator_solve_q31(anhyst_compensator *c, int32_t demand, int32_t gap);

/* Advances the memory with the current that was applied, at the gap there was. If both are what
   was solved for, this costs a copy; near it, as what a converter's grid makes of it, a fraction of
   a solve; otherwise at most about one and a half times as much as a solve. */
void anhyst_compensator_commit_q15(anhyst_compensator *c, int16_t applied, int16_t gap);
void anhyst_compensator_commit_q31(anhyst_compensator *c, int32_t applied, int32_t gap);

/* The output that the model expects after the last commit. */
int16_t anhyst_compensator_output_q15(const anhyst_compensator *c);
int32_t anhyst_compensator_output_q31(const anhyst_compensator *c);

/* The root of a q31, 0 of what is below 0: relative error below 2e-9 plus two units in the last
   place, a straight line below 2^-16 of full scale. */
int32_t anhyst_root_q31(int32_t a);

/* Number of ticks of the sequence that makes an unknown state known. */
int32_t anhyst_conditioning_length(const anhyst_compensator *c);

/* The current of its tick 0, 1, ...: triangles between the limits of the current; 0 after the
   end. Apply it and commit it as any other. Afterwards the force can be trusted: what is left of
   an unknown start is in manifest.json (conditioning). */
int16_t anhyst_conditioning_q15(const anhyst_compensator *c, int32_t tick);
int32_t anhyst_conditioning_q31(const anhyst_compensator *c, int32_t tick);

#ifdef __cplusplus
}
#endif
#endif
