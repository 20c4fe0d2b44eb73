/* SPDX-License-Identifier: Apache-2.0 */
/* Solid iron in fixed point: layers of the law of cells, from the surface to the middle, with
   diffusion between them. Equations and the way they are solved are those of generic/solid.h, but
   for one thing: what the last pass leaves of them is owed to the next tick. A tick changes the
   flux of a slow drive by less than a row can be read, 2^-14 of a segment; the fields between the
   layers would be off by many times that.

   Fields, fluxes and sections are q30, slopes of a field over a flux have 16 bits behind the point,
   from 0 to 32768. Slopes only say where a layer meets its line, and what they miss is looked at
   again; fields and fluxes have all 32 bits. Everything saturates. */
#include "block.h"
#include "cells_path.h"
#include "lookup.h"

#if ANHYST_MEMORIES > 1
/* Passes at most. One does where no layer leaves its segment; where a layer is softer on one side
   of its place than on the other, two may go to and fro for ever, which a third one ends. */
#define PASSES 3

/* What may be left of the equations: 2^-15 of the largest field, and that of a flux of 2^-19. It is
   owed, and less than what reading the rows leaves; a pass more is worth nothing below it. */
#define CLOSE 32768

/* A flux that is further than this from what was wanted was not reached: 2^-14. */
#define REACHED 65536

/* Flux that a layer is owed at most, q30: 2^-8. */
#define MOST_OWED 4194304

/* Of a layer in the section, at least: 2^-9, q15. */
#define LEAST_SHARE 64

/* All memories at one tick: layers from the surface on, then what is laminated. */
typedef struct {
  anhyst_compensator *c;
  int flux_given;                     /* whether the flux of the section is known */
  int32_t given;                      /* it, or the current beyond its bias */
  int32_t hold;                       /* field from layer to layer for a change of flux, a slope */
  int32_t own;                        /* field of a flux in its layer, a slope, <= 0 */
  int32_t reluctance;                 /* of what is around thin iron, a slope */
  int32_t arm;                        /* 1 over the field arm beyond what is laminated, a slope */
  int16_t layers;                     /* N */
  int16_t laminated;                  /* q15 */
  int16_t share[ANHYST_MEMORIES];     /* phi_j, q15 */
  int32_t before[ANHYST_MEMORIES];    /* S_j when the tick began */
  int32_t section[ANHYST_MEMORIES];   /* S_j */
  int32_t flux[ANHYST_MEMORIES];      /* in the layer itself */
  int32_t field[ANHYST_MEMORIES];     /* E_j, E_l */
  int32_t stiffness[ANHYST_MEMORIES]; /* their slopes over S_j, and over the flux of E_l */
  int32_t left[ANHYST_MEMORIES];      /* of the equation between a layer and the one before it */
} solid_tick;

/* What lies further out, from one section on: a field, and by how much it falls as the flux of that
   section rises. */
typedef struct {
  int32_t field;
  int32_t falls; /* a slope, >= 0 */
} solid_line;

static const anhyst_cells_memory *memory_of(const anhyst_compensator *c, int16_t at)
{
  return at > 0 ? &c->deeper[at - 1].memory.cells : &c->memory.cells;
}

static anhyst_candidate *next_of(anhyst_compensator *c, int16_t at)
{
  return at > 0 ? &c->deeper[at - 1].next : &c->next;
}

static const int32_t *plays_of(const anhyst_compensator *c, int16_t at)
{
  return at > 0 ? c->deeper[at - 1].plays : c->plays;
}

/* Layers of a block; 0: thin iron. */
static int16_t layers_of(const int16_t *words) { return words[ANHYST_WORD_SOLID_LAYERS]; }

/* How many memories a block needs. */
static int16_t memories_of(const int16_t *words)
{
  return (int16_t)(layers_of(words) + (words[ANHYST_WORD_SOLID_LAMINATED] > 0 ? 1 : 0));
}

/* a times a slope that is not negative. */
static int32_t sloped(int32_t a, int32_t slope)
{
  if (slope <= 0) {
    return 0;
  }
  const uint16_t up = anhyst_headroom(slope);
  const int16_t weight = (int16_t)((int32_t)((uint32_t)slope << up) >> 16);
  if (up < 16U) {
    return anhyst_shl_q31(anhyst_scale(anhyst_shl_q31(a, (uint16_t)(15U - up)), weight), 1);
  }
  return anhyst_scale(a, weight) >> (up - 16U);
}

/* a times a part of 1, q15. */
static int32_t shared(int32_t a, int16_t part) { return anhyst_shl_q31(anhyst_scale(a, part), 1); }

/* The flux of which a layer has this part in the section. What the first quotient misses is looked
   at again. */
static int32_t whole_of(int32_t a, int16_t share)
{
  const int32_t inverse = ANHYST_Q31_MAX / (share > 0 ? share : 1);
  const int32_t first = sloped(a, inverse);
  return anhyst_add_q31(first, sloped(anhyst_sub_q31(a, shared(first, share)), inverse));
}

/* Takes up where a memory stands. */
static void take_up(solid_tick *tick, int16_t at, int32_t flux)
{
  const int32_t own = anhyst_shl_q31(anhyst_scale(flux, (int16_t)(tick->own >> 2)), 2);
  tick->flux[at] = flux;
  tick->field[at] = anhyst_add_q31(next_of(tick->c, at)->memory.cells.x, own);
}

/* The slope of the segment on which it stands. */
static int32_t stiffness_of(const solid_tick *tick, int16_t at)
{
  const anhyst_candidate *there = next_of(tick->c, at);
  const int32_t width = (int32_t)((uint32_t)0x8000 << there->fine);
  const int32_t rise =
      (int32_t)there->m_slope * 8192 + anhyst_scale(width, tick->c->words[ANHYST_WORD_CELLS_AIR]);
  const int32_t law = anhyst_quotient(width, rise > 0 ? rise : 1) >> 2;
  const int32_t stiff = law + tick->own > 1 ? law + tick->own : 1;
  if (at == tick->layers) {
    return stiff;
  }
  const int32_t shared_stiff = anhyst_quotient(stiff, (int32_t)tick->share[at] * 2);
  return shared_stiff > 0 ? shared_stiff : 1;
}

/* The flux in a layer and deeper. */
static int32_t section_with(const solid_tick *tick, int16_t layer, int32_t deeper)
{
  return anhyst_add_q31(deeper, shared(tick->flux[layer], tick->share[layer]));
}

/* Where the search of a memory sets out: where it stands itself, or what was solved. */
static void set_out(solid_tick *tick, int16_t at, int known, int solved)
{
  anhyst_compensator *c = tick->c;
  anhyst_candidate *there = next_of(c, at);
  if (!known || !is_placed(there)) {
    take_up(tick, at, anhyst_cells_stand(c->words, memory_of(c, at), plays_of(c, at), there));
    tick->stiffness[at] = stiffness_of(tick, at);
    return;
  }
  if (!solved) { /* it can turn where it stands */
    const int32_t x = there->memory.cells.x;
    there->memory.cells.joined = anhyst_sat_q30(there->memory.cells.active < 0 ? ~x : x);
  }
  take_up(tick, at, anhyst_cells_flux_of(c->words, there));
  tick->stiffness[at] = at > 0 ? c->deeper[at - 1].stiffness : stiffness_of(tick, at);
}

/* Sections of the state, and where the search sets out: what was solved, or the state. */
static void begin_tick(solid_tick *tick, anhyst_compensator *c, int solved)
{
  const int16_t *words = c->words;
  const int16_t surface = words[ANHYST_WORD_SOLID_SURFACE];
  const int16_t layers = (int16_t)anhyst_clamp(layers_of(words), 2, ANHYST_MEMORIES);
  const int16_t inner = (int16_t)((32768 - surface) / (layers - 1));
  const int known = is_placed(&c->next);
  int32_t now = 0;
  tick->c = c;
  tick->layers = layers;
  tick->laminated = words[ANHYST_WORD_SOLID_LAMINATED];
  tick->hold = (int32_t)words[ANHYST_WORD_SOLID_HOLD] << words[ANHYST_WORD_SOLID_HOLD_SHIFT];
  tick->own = (int32_t)words[ANHYST_WORD_SOLID_OWN] * 4;
  for (int16_t j = (int16_t)(layers - 1); j > 0; j--) {
    anhyst_deeper *deeper = &c->deeper[j - 1];
    tick->share[j] = inner;
    set_out(tick, j, known, solved);
    now = section_with(tick, j, now);
    tick->section[j] = now;
    if (!solved) {
      deeper->before = anhyst_add_q31(now, deeper->owed);
    }
    tick->before[j] = deeper->before;
  }
  tick->share[0] = surface;
  set_out(tick, 0, known, solved);
  tick->section[0] = section_with(tick, 0, now);
  if (tick->laminated > 0) {
    set_out(tick, layers, known, solved);
  }
}

/* What stands for the field of thin iron in the current. */
static int32_t field_in_current(const solid_tick *tick)
{
  int32_t field = tick->field[0];
  if (tick->laminated > 0) {
    const int32_t beyond = anhyst_sub_q31(tick->field[tick->layers], field);
    field = anhyst_add_q31(field, shared(beyond, tick->laminated));
  }
  const int32_t own = anhyst_scale(tick->section[0], (int16_t)(tick->own >> 2));
  return anhyst_sub_q31(field, anhyst_shl_q31(own, 2));
}

/* What the arms of a current make of it. */
static void set_circuit(solid_tick *tick)
{
  const anhyst_arms *arms = &tick->c->arms;
  const int32_t arm = ((int32_t)arms->field_arm * (32768 - tick->laminated)) >> 15;
  tick->arm = anhyst_quotient(65536, arm > 0 ? arm : 1);
  tick->reluctance = -tick->own;
  if (arms->flux_arm > 0) {
    const int32_t ratio = anhyst_quotient(arms->flux_arm, arms->field_arm);
    tick->reluctance = anhyst_add_q31(tick->reluctance, ratio);
  } else if (arms->flux_arm < 0) {
    const int32_t ratio = anhyst_quotient(-arms->flux_arm, arms->field_arm);
    tick->reluctance = anhyst_sub_q31(tick->reluctance, ratio);
  }
}

/* The line that the circuit, and what is laminated, put before the surface: what is missing of the
   current there, and how it falls. */
static solid_line outside(const solid_tick *tick)
{
  const anhyst_arms *arms = &tick->c->arms;
  const int32_t made = anhyst_add_q31(anhyst_scale(tick->section[0], arms->flux_arm),
                                      anhyst_scale(field_in_current(tick), arms->field_arm));
  const int32_t missing = anhyst_sub_q31(tick->given, made);
  const int32_t solid = 32768 - tick->laminated;
  int32_t reluctance = tick->reluctance;
  if (tick->laminated > 0) {
    reluctance = anhyst_add_q31(reluctance, shared(tick->stiffness[tick->layers], tick->laminated));
  }
  solid_line line;
  line.field = anhyst_add_q31(tick->field[0], sloped(missing, tick->arm));
  line.falls = reluctance > 0 ? anhyst_quotient(reluctance, 2 * solid) : 0;
  return line;
}

/* The line behind a layer, of which the one before it is given; that of the surface where its flux
   is known. */
static solid_line behind(const solid_tick *tick, int16_t layer, solid_line line)
{
  const int32_t stiff = tick->stiffness[layer];
  solid_line found = {tick->field[layer], stiff};
  if (layer == 0 && tick->flux_given) {
    const int32_t beyond = anhyst_sub_q31(tick->given, tick->section[0]);
    found.field = anhyst_add_q31(found.field, sloped(beyond, stiff));
  } else {
    const int32_t whole = anhyst_add_q31(line.falls, stiff);
    const int16_t part = anhyst_sat_q15(anhyst_quotient(stiff, whole) >> 1);
    const int32_t beyond = anhyst_sub_q31(line.field, tick->field[layer]);
    found.field = anhyst_add_q31(found.field, shared(beyond, part));
    found.falls = shared(line.falls, part);
  }
  const int16_t next = (int16_t)(layer + 1);
  const int32_t change = anhyst_sub_q31(tick->section[next], tick->before[next]);
  found.field = anhyst_sub_q31(found.field, sloped(change, tick->hold));
  found.falls = anhyst_add_q31(found.falls, tick->hold);
  return found;
}

/* Lets a memory meet what its arms make of flux and field. */
static void meet(solid_tick *tick, int16_t at, const anhyst_arms *arms, int32_t target)
{
  anhyst_compensator *c = tick->c;
  anhyst_candidate *to = next_of(c, at);
  const int16_t segment = to->y_slope;
  const uint16_t fine = to->fine;
  take_up(tick, at,
          anhyst_cells_meet(c->words, memory_of(c, at), plays_of(c, at), arms, target, to));
  if (to->y_slope != segment || to->fine != fine) {
    tick->stiffness[at] = stiffness_of(tick, at);
  }
}

static void meet_flux(solid_tick *tick, int16_t at, int32_t flux)
{
  const anhyst_arms arms = {0, 16384, 0};
  meet(tick, at, &arms, flux >> 4);
}

/* Lets a layer meet its line, which is that at its own section of before: what has changed below it
   comes off. All is halved so often that the arms fit. */
static void meet_line(solid_tick *tick, int16_t layer, solid_line line, int32_t changed)
{
  const int16_t share = tick->share[layer];
  const int32_t falls = shared(line.falls, share);
  const uint16_t up = anhyst_headroom(falls > 0 ? falls : 1);
  const uint16_t halvings = up < 14U ? (uint16_t)(16U - up) : 2U;
  const int16_t falling = (int16_t)(falls >> halvings);
  anhyst_arms arms;
  arms.bias = 0;
  arms.flux_arm = (int16_t)(falling + (tick->own >> halvings));
  arms.field_arm = (int16_t)(65536 >> halvings);
  const int32_t field = anhyst_sub_q31(line.field, sloped(changed, line.falls));
  meet(tick, layer, &arms,
       (field >> (halvings + 2U)) + anhyst_scale(tick->flux[layer] >> 2, falling));
}

/* Once in and out. */
static void pass(solid_tick *tick)
{
  const int16_t layers = tick->layers;
  solid_line line[ANHYST_MEMORIES];
  int32_t deeper = 0;
  int32_t changed = 0;
  line[0].field = 0;
  line[0].falls = 0;
  if (!tick->flux_given) {
    line[0] = outside(tick);
  }
  for (int16_t j = 1; j < layers; j++) {
    line[j] = behind(tick, (int16_t)(j - 1), line[j - 1]);
  }
  for (int16_t j = (int16_t)(layers - 1); j > 0; j--) {
    meet_line(tick, j, line[j], changed);
    deeper = section_with(tick, j, deeper);
    changed = anhyst_sub_q31(deeper, tick->section[j]);
    tick->section[j] = deeper;
  }
  if (tick->flux_given) {
    meet_flux(tick, 0, whole_of(anhyst_sub_q31(tick->given, deeper), tick->share[0]));
  } else {
    meet_line(tick, 0, line[0], changed);
  }
  tick->section[0] = section_with(tick, 0, deeper);
  if (tick->laminated > 0) {
    meet_flux(tick, layers, tick->section[0]);
  }
}

/* What is left of the equation between a layer and the one before it, a field. */
static int32_t left_at_layer(const solid_tick *tick, int16_t layer)
{
  const int32_t change = anhyst_sub_q31(tick->section[layer], tick->before[layer]);
  const int32_t falls = anhyst_sub_q31(tick->field[layer - 1], tick->field[layer]);
  return anhyst_sub_q31(falls, sloped(change, tick->hold));
}

/* Whether the equations are met, as far as rounding lets them. */
static int is_met(solid_tick *tick)
{
  int met = 1;
  for (int16_t j = 1; j < tick->layers; j++) {
    tick->left[j] = left_at_layer(tick, j);
    const int32_t slope = anhyst_add_q31(tick->stiffness[j - 1], tick->hold);
    if (anhyst_abs_q31(tick->left[j]) > CLOSE + (slope >> 5)) {
      met = 0;
    }
  }
  if (met && !tick->flux_given) {
    const solid_line line = outside(tick);
    return anhyst_abs_q31(anhyst_sub_q31(line.field, tick->field[0])) <= CLOSE + (line.falls >> 5);
  }
  return met;
}

/* The flux that the fields have let into a layer and deeper beyond what is found there. */
static int32_t owed_by(const solid_tick *tick, int16_t layer)
{
  const int16_t *words = tick->c->words;
  const int32_t inverse = ANHYST_Q31_MAX / words[ANHYST_WORD_SOLID_HOLD];
  const int32_t flux = anhyst_shl_q31(sloped(tick->left[layer], inverse), 1);
  return anhyst_clamp(flux >> words[ANHYST_WORD_SOLID_HOLD_SHIFT], -MOST_OWED, MOST_OWED);
}

static void solve_tick(solid_tick *tick)
{
  for (uint16_t i = 0; i < PASSES; i++) {
    pass(tick);
    if (is_met(tick)) {
      break;
    }
  }
  for (int16_t j = 1; j < tick->layers; j++) {
    tick->c->deeper[j - 1].next_owed = owed_by(tick, j);
  }
  for (int16_t j = 1; j < memories_of(tick->c->words); j++) {
    tick->c->deeper[j - 1].stiffness = tick->stiffness[j];
  }
}

/* What stands for the field of thin iron in the current. The flux that is solved for comes down
   where the surface saturates before it is reached. */
static int32_t solid_field(anhyst_compensator *c)
{
  solid_tick tick;
  begin_tick(&tick, c, 0);
  tick.flux_given = 1;
  tick.given = c->flux;
  solve_tick(&tick);
  if (anhyst_abs_q31(anhyst_sub_q31(tick.section[0], c->flux)) > REACHED) {
    c->flux = anhyst_clamp(tick.section[0], -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
    c->flags |= ANHYST_FLUX_LIMITED;
  }
  return anhyst_sat_q30(field_in_current(&tick));
}

/* The flux of the section to which a current leads. */
static int32_t solid_flux(anhyst_compensator *c, int32_t current)
{
  solid_tick tick;
  begin_tick(&tick, c, c->solved != 0U);
  set_circuit(&tick);
  tick.flux_given = 0;
  tick.given = anhyst_sub_q31(current, c->arms.bias);
  solve_tick(&tick);
  return tick.section[0];
}

/* All layers begin as the surface does. */
static void solid_start(anhyst_compensator *c)
{
  anhyst_cells_start(c->words, c->plays, &c->memory.cells);
  for (uint16_t i = 0; i < ANHYST_MEMORIES - 1; i++) {
    anhyst_deeper *deeper = &c->deeper[i];
    deeper->memory = c->memory;
    deeper->next = c->next;
    deeper->owed = 0;
    deeper->next_owed = 0;
    for (uint16_t cell = 0; cell < ANHYST_CELLS; cell++) {
      deeper->plays[cell] = c->plays[cell];
    }
  }
}

static void solid_keep(anhyst_compensator *c)
{
  for (int16_t at = (int16_t)(memories_of(c->words) - 1); at >= 0; at--) {
    int32_t *plays = at > 0 ? c->deeper[at - 1].plays : c->plays;
    if (have_turned(memory_of(c, at), &next_of(c, at)->memory.cells)) {
      anhyst_cells_keep(c->words, memory_of(c, at), plays);
    }
    if (at > 0) {
      c->deeper[at - 1].memory = c->deeper[at - 1].next.memory;
      c->deeper[at - 1].owed = c->deeper[at - 1].next_owed;
    }
  }
}

/* Each layer is brought to the flux that it had, and what that of the section changes. One that the
   block before did not have begins as the surface does. */
static void solid_carry(anhyst_compensator *c, const int16_t *words, int32_t flux)
{
  const int16_t known = memories_of(c->words);
  const int32_t change = anhyst_sub_q31(flux, c->flux_applied);
  for (int16_t at = (int16_t)(memories_of(words) - 1); at >= 0; at--) {
    const int16_t from = at < known ? at : 0;
    anhyst_cells_memory *memory = at > 0 ? &c->deeper[at - 1].memory.cells : &c->memory.cells;
    int32_t *plays = at > 0 ? c->deeper[at - 1].plays : c->plays;
    anhyst_candidate there;
    const int32_t before =
        anhyst_cells_stand(c->words, memory_of(c, from), plays_of(c, from), &there);
    const int32_t now = anhyst_add_q31(before, change);
    for (uint16_t cell = 0; cell < ANHYST_CELLS; cell++) {
      plays[cell] = plays_of(c, from)[cell];
    }
    *memory = there.memory.cells;
    anhyst_cells_carry(c->words, words, anhyst_clamp(now, -ANHYST_Q30_ONE, ANHYST_Q30_ONE), memory,
                       plays);
    if (at > from) {
      c->deeper[at - 1].owed = 0;
    }
  }
}

int anhyst_solid_is_valid(const int16_t *words)
{
  return anhyst_within(layers_of(words), 2, ANHYST_MEMORIES) &&
         memories_of(words) <= ANHYST_MEMORIES &&
         anhyst_within(words[ANHYST_WORD_SOLID_HOLD], 1, ANHYST_Q15_MAX) &&
         anhyst_within(words[ANHYST_WORD_SOLID_HOLD_SHIFT], 0, 15) &&
         anhyst_within(words[ANHYST_WORD_SOLID_OWN], -ANHYST_Q15_MAX, 0) &&
         anhyst_within(words[ANHYST_WORD_SOLID_SURFACE], LEAST_SHARE, 32768 - 3 * LEAST_SHARE) &&
         anhyst_within(words[ANHYST_WORD_SOLID_LAMINATED], 0, ANHYST_Q15_MAX);
}

const anhyst_kernel anhyst_kernel_solid = {ANHYST_KIND_CELLS,     solid_field,           solid_flux,
                                           anhyst_cells_is_valid, solid_carry,           solid_keep,
                                           solid_start,           anhyst_cells_for_block};
#endif
