/* SPDX-License-Identifier: Apache-2.0 */
/* Solid iron: layers of the law of play cells, from the surface to the middle, with diffusion
   between them. Template for one format; generic/cells.h is included before. Layer j of N has a
   share phi_j of the section, and S_j is the flux in it and deeper:

     E_j = x_j + own*f_j,   E_{j-1} = E_j + hold*(S_j - S_j,before),   j = 2..N
     current = bias + flux_arm*F + field_arm*(l*E_l(F) + (1 - l)*E_1 - own*F),   F = S_1

   A pass goes inwards and outwards. Inwards, everything further out is a straight line, from the
   tangents of the layers at their last positions. Outwards, each layer meets its line with its own
   law, exactly, from the middle on. The error of a pass is the difference between tangents and law.
   The residual of the last pass is owed to the next tick: a tick of a slow drive changes the flux
   by less than the resolution of a row, and the fields between the layers would have many times
   that error.

   Slopes are of a field over a flux. They are approximate: a pass checks their result. One pass is
   enough if no layer leaves its segment. Tangents may lead to and fro for ever if the flux jumps
   within a tick. Therefore, later passes take the slope between two positions of a layer that are
   far from each other. */

/* Maximum number of passes, and how many of them take tangents alone. */
#define MAX_PASSES 10
#define TANGENT_PASSES 2

/* Smallest change of the flux of a layer for a slope between two positions. */
#define MIN_SECANT_FLUX POWER_OF_HALF(7)

/* Smallest change of flux in a pass for which another pass is worth while. */
#define MIN_MOVED_FLUX POWER_OF_HALF(19)

/* Residual of a flux above which the flux was not reached. */
#define REACHED_FLUX POWER_OF_HALF(14)

/* Largest flux that is owed to a layer. */
#define MAX_OWED POWER_OF_HALF(8)

/* All memories in one tick: layers from the surface on, then the laminated part. */
typedef struct {
  compensator *c;
  int is_flux_given;                 /* whether the flux of the section is known */
  int takes_secants;                 /* whether slopes are those between two positions */
  number given;                      /* this flux, or the current minus its bias */
  number hold;                       /* field from layer to layer for a change of flux, a slope */
  number own;                        /* field of a flux in its layer, a slope, <= 0 */
  number reluctance;                 /* of the circuit around thin iron, a slope */
  number arm;                        /* 1 over the field arm without the laminated part, a slope */
  int layers;                        /* N */
  entry laminated;                   /* l */
  entry share[ANHYST_MEMORIES];      /* phi_j */
  number before[ANHYST_MEMORIES];    /* S_j at the beginning of the tick */
  number section[ANHYST_MEMORIES];   /* S_j */
  number flux[ANHYST_MEMORIES];      /* in the layer itself */
  number field[ANHYST_MEMORIES];     /* E_j, E_l */
  number stiffness[ANHYST_MEMORIES]; /* their slopes over S_j, and over the flux for E_l */
  number left[ANHYST_MEMORIES]; /* residual of the equation between a layer and the one before */
} solid_tick;

/* The circuit outside of a section: a field, and how much it falls as the flux of that section
   rises. The field is coarse() since that of a jump is many times the largest of the rows. */
typedef struct {
  number field;
  number falls; /* a slope, >= 0 */
} solid_line;

static const cells_memory *memory_of(const compensator *c, int at)
{
  return at > 0 ? &c->deeper[at - 1].memory.cells : &c->memory.cells;
}

static candidate *next_of(compensator *c, int at)
{
  return at > 0 ? &c->deeper[at - 1].next : &c->next;
}

static const number *plays_of(const compensator *c, int at)
{
  return at > 0 ? c->deeper[at - 1].plays : c->plays;
}

/* Number of layers of a block; 0: thin iron. */
static int layers_of(const entry *words) { return integer_of(words[ANHYST_WORD_SOLID_LAYERS]); }

/* Number of memories that a block needs. */
static int memories_of(const entry *words)
{
  return layers_of(words) + (words[ANHYST_WORD_SOLID_LAMINATED] > 0 ? 1 : 0);
}

/* The flux of h*x + m at a candidate. */
static number flux_of_candidate(const entry *words, const candidate *at)
{
  const int mirror = at->memory.cells.active < 0 ? -1 : 0;
  const number x = mirrored(at->memory.cells.x, mirror);
  const number share = rise_share(rise_on(at, words[ANHYST_WORD_CELLS_AIR]),
                                  part_at(x, begin_at(at, x), grid_at(at)));
  return four_times(mirrored(unsafe_sum(at->of.cells.flux, share), mirror));
}

/* Makes a candidate of a memory; returns the flux there. */
static number stand(const entry *words, const cells_memory *memory, const number *plays,
                    candidate *at)
{
  cell_path along;
  begin_path(&along, words, memory, plays);
  along.low = along.x;
  along.segment = spot_on(&along, along.row, along.x).at;
  at->of.cells.joins = joins_at(&along, along.active, along.x);
  return four_times(arrive(&along, words, at));
}

/* Reads flux and field at the candidate of a memory. */
static void read_candidate(solid_tick *tick, int at, number flux)
{
  tick->flux[at] = flux;
  tick->field[at] = sum(next_of(tick->c, at)->memory.cells.x, own_field(flux, tick->own));
}

/* The slope of the segment of its candidate. */
static number stiffness_of(const solid_tick *tick, int at)
{
  const candidate *there = next_of(tick->c, at);
  const number rise = rise_on(there, tick->c->words[ANHYST_WORD_CELLS_AIR]);
  const number stiff = law_stiffness(width_of(grid_at(there)), rise, tick->own);
  return at == tick->layers ? stiff : per_share(stiff, tick->share[at]);
}

/* The flux in a layer and deeper. */
static number section_with(const solid_tick *tick, int layer, number deeper)
{
  return sum(deeper, shared(tick->flux[layer], tick->share[layer]));
}

/* Sets where the search of a memory begins: at the memory, or at its candidate if that is known. */
static void set_out(solid_tick *tick, int at)
{
  compensator *c = tick->c;
  candidate *there = next_of(c, at);
  if (c->stage == ANHYST_STAGE_UNKNOWN || !is_placed(there)) {
    read_candidate(tick, at, stand(c->words, memory_of(c, at), plays_of(c, at), there));
    tick->stiffness[at] = stiffness_of(tick, at);
    return;
  }
  if (c->stage == ANHYST_STAGE_HERE) { /* the path can reverse here */
    const int mirror = there->memory.cells.active < 0 ? -1 : 0;
    there->memory.cells.joined = inside(mirrored(there->memory.cells.x, mirror));
  }
  read_candidate(tick, at, flux_of_candidate(c->words, there));
  const number known = at > 0 ? c->deeper[at - 1].stiffness : 0;
  tick->stiffness[at] = known > 0 ? known : stiffness_of(tick, at);
}

/* Sets the sections of the state, and where the search begins. */
static void begin_tick(solid_tick *tick, compensator *c)
{
  const entry *words = c->words;
  const entry surface = words[ANHYST_WORD_SOLID_SURFACE];
  const int layers = layers_of(words);
  number now = 0;
  tick->c = c;
  tick->layers = layers;
  tick->laminated = words[ANHYST_WORD_SOLID_LAMINATED];
  tick->hold = hold_of(words);
  tick->own = own_of(words);
  for (int j = layers - 1; j > 0; j--) {
    tick->share[j] = inner_share(surface, layers - 1);
    set_out(tick, j);
    now = section_with(tick, j, now);
    tick->section[j] = now;
    if (c->stage != ANHYST_STAGE_AHEAD) {
      c->deeper[j - 1].before = sum(now, c->deeper[j - 1].owed);
    }
    tick->before[j] = c->deeper[j - 1].before;
  }
  tick->share[0] = surface;
  set_out(tick, 0);
  tick->section[0] = section_with(tick, 0, now);
  if (tick->laminated > 0) {
    set_out(tick, layers);
  }
}

/* The field that takes the place of that of thin iron in the current. */
static number field_in_current(const solid_tick *tick)
{
  number field = tick->field[0];
  if (tick->laminated > 0) {
    field = sum(field, shared(difference(tick->field[tick->layers], field), tick->laminated));
  }
  return difference(field, own_field(tick->section[0], tick->own));
}

/* Sets the slopes of the circuit from the arms of a current. */
static void set_circuit(solid_tick *tick)
{
  const arms_type *arms = &tick->c->arms;
  tick->arm = slope_of_arm(arms->field_arm, tick->laminated);
  tick->reluctance = -tick->own;
  if (arms->flux_arm > 0) {
    tick->reluctance = sum(tick->reluctance, ratio(arms->flux_arm, arms->field_arm));
  } else if (arms->flux_arm < 0) {
    tick->reluctance = difference(tick->reluctance, ratio(-arms->flux_arm, arms->field_arm));
  }
}

/* The current that is missing. */
static number missing_current(const solid_tick *tick)
{
  const arms_type *arms = &tick->c->arms;
  const number made = sum(scaled(tick->section[0], arms->flux_arm),
                          scaled(field_in_current(tick), arms->field_arm));
  return difference(tick->given, made);
}

/* How much the field outside of the surface falls as the flux of the section rises, a slope. */
static number falls_outside(const solid_tick *tick)
{
  number reluctance = tick->reluctance;
  if (tick->laminated > 0) {
    reluctance = sum(reluctance, shared(tick->stiffness[tick->layers], tick->laminated));
  }
  return reluctance > 0 ? per_solid(reluctance, tick->laminated) : 0;
}

/* The line of the circuit and the laminated part at the surface. */
static solid_line outside(const solid_tick *tick)
{
  solid_line line;
  line.field = sum(coarse(tick->field[0]), sloped(coarse(missing_current(tick)), tick->arm));
  line.falls = falls_outside(tick);
  return line;
}

/* The line after a layer, given the line before it; after the surface if its flux is known. */
static solid_line behind(const solid_tick *tick, int layer, solid_line line)
{
  const number stiff = tick->stiffness[layer];
  const number here = coarse(tick->field[layer]);
  solid_line found = {here, stiff};
  if (layer == 0 && tick->is_flux_given) {
    const number change = difference(tick->given, tick->section[0]);
    found.field = sum(here, sloped(coarse(change), stiff));
  } else {
    const entry part = part_of_slopes(stiff, line.falls);
    found.field = sum(here, shared(difference(line.field, here), part));
    found.falls = shared(line.falls, part);
  }
  const number change = difference(tick->section[layer + 1], tick->before[layer + 1]);
  found.field = difference(found.field, sloped(coarse(change), tick->hold));
  found.falls = sum(found.falls, tick->hold);
  return found;
}

/* The slope of a memory that has left its segment, from this flux and field. */
static number slope_from(const solid_tick *tick, int at, number flux, number field)
{
  const number change = difference(tick->flux[at], flux);
  if (!tick->takes_secants || size_of(change) < MIN_SECANT_FLUX) {
    return stiffness_of(tick, at);
  }
  const number slope = secant(difference(tick->field[at], field), change);
  return at == tick->layers ? slope : per_share(slope, tick->share[at]);
}

/* Solves a memory for a target of its arms, over 4. */
static void meet(solid_tick *tick, int at, const arms_type *arms, number target)
{
  compensator *c = tick->c;
  candidate *to = next_of(c, at);
  const int32_t segment = to->of.cells.segment;
  const number flux = tick->flux[at];
  const number field = tick->field[at];
  (void)reach_current(c->words, memory_of(c, at), plays_of(c, at), arms, target, to, 1);
  read_candidate(tick, at, flux_of_candidate(c->words, to));
  if (to->of.cells.segment != segment) {
    tick->stiffness[at] = slope_from(tick, at, flux, field);
  }
}

static void meet_flux(solid_tick *tick, int at, number flux)
{
  const arms_type arms = {0, QUARTER_WEIGHT, 0};
  meet(tick, at, &arms, quarter(quarter(flux)));
}

/* Solves a layer for its line, which is that at its previous section; the change of the section
   below is subtracted. */
static void meet_line(solid_tick *tick, int layer, solid_line line, number changed)
{
  const number falls = shared(line.falls, tick->share[layer]);
  const number field = difference(line.field, sloped(coarse(changed), line.falls));
  arms_type arms;
  const number target = set_line(&arms, field, falls, tick->own, tick->flux[layer]);
  meet(tick, layer, &arms, target);
}

/* Once inwards and outwards. Returns by how much the flux of the sections has changed. */
static number pass(solid_tick *tick)
{
  const int layers = tick->layers;
  const number first = tick->section[0];
  number moved = 0;
  solid_line line[ANHYST_MEMORIES];
  number deeper = 0;
  number changed = 0;
  line[0].field = 0;
  line[0].falls = 0;
  if (!tick->is_flux_given) {
    line[0] = outside(tick);
  }
  for (int j = 1; j < layers; j++) {
    line[j] = behind(tick, j - 1, line[j - 1]);
  }
  for (int j = layers - 1; j > 0; j--) {
    meet_line(tick, j, line[j], changed);
    deeper = section_with(tick, j, deeper);
    changed = difference(deeper, tick->section[j]);
    moved = sum(moved, size_of(changed));
    tick->section[j] = deeper;
  }
  if (tick->is_flux_given) {
    meet_flux(tick, 0, whole_of(difference(tick->given, deeper), tick->share[0]));
  } else {
    meet_line(tick, 0, line[0], changed);
  }
  tick->section[0] = section_with(tick, 0, deeper);
  if (tick->laminated > 0) {
    meet_flux(tick, layers, tick->section[0]);
  }
  return sum(moved, size_of(difference(tick->section[0], first)));
}

/* Whether the equations are solved, except for rounding. Sets their residuals. */
static int is_met(solid_tick *tick)
{
  int met = 1;
  for (int j = 1; j < tick->layers; j++) {
    const number change = difference(tick->section[j], tick->before[j]);
    const number falls = difference(tick->field[j - 1], tick->field[j]);
    tick->left[j] = difference(falls, sloped(change, tick->hold));
    if (!is_residual_small(tick->left[j], sum(tick->stiffness[j - 1], tick->hold))) {
      met = 0;
    }
  }
  if (met && !tick->is_flux_given) {
    return is_residual_small(sloped(missing_current(tick), tick->arm), falls_outside(tick));
  }
  return met;
}

static void solve_tick(solid_tick *tick)
{
  for (int i = 0; i < MAX_PASSES; i++) {
    tick->takes_secants = i >= TANGENT_PASSES;
    const number moved = pass(tick);
    if (is_met(tick) || moved < MIN_MOVED_FLUX) { /* a saturated surface may not meet them */
      break;
    }
  }
  for (int j = 1; j < tick->layers; j++) {
    tick->c->deeper[j - 1].next_owed = owed_flux(tick->c->words, tick->left[j], MAX_OWED);
  }
  for (int j = 1; j < memories_of(tick->c->words); j++) {
    tick->c->deeper[j - 1].stiffness = tick->stiffness[j];
  }
}

/* The field that takes the place of that of thin iron in the current. The flux that is solved for
   is reduced if the surface saturates before it is reached. */
static number solid_field(compensator *c)
{
  solid_tick tick;
  begin_tick(&tick, c);
  tick.is_flux_given = 1;
  tick.given = c->flux;
  solve_tick(&tick);
  const number missing = difference(tick.section[0], c->flux);
  if (missing > REACHED_FLUX || missing < -REACHED_FLUX) {
    c->flux = inside(tick.section[0]);
    c->flags |= ANHYST_FLUX_LIMITED;
  }
  return inside(field_in_current(&tick));
}

/* The flux of the section to which a current leads. */
static number solid_flux(compensator *c, number current)
{
  solid_tick tick;
  begin_tick(&tick, c);
  set_circuit(&tick);
  tick.is_flux_given = 0;
  tick.given = difference(current, c->arms.bias);
  solve_tick(&tick);
  return tick.section[0];
}

/* All layers begin as the surface does. */
static void solid_start(compensator *c)
{
  cells_start(c);
  for (int i = 0; i < ANHYST_MEMORIES - 1; i++) {
    c->deeper[i].memory = c->memory;
    c->deeper[i].next = c->next;
    c->deeper[i].owed = 0;
    c->deeper[i].next_owed = 0;
    for (int cell = 0; cell < ANHYST_CELLS; cell++) {
      c->deeper[i].plays[cell] = c->plays[cell];
    }
  }
}

static void solid_keep(compensator *c)
{
  for (int at = memories_of(c->words) - 1; at >= 0; at--) {
    number *plays = at > 0 ? c->deeper[at - 1].plays : c->plays;
    if (have_turned(memory_of(c, at), &next_of(c, at)->memory.cells)) {
      keep_plays(c->words, memory_of(c, at), plays);
    }
    if (at > 0) {
      c->deeper[at - 1].memory = c->deeper[at - 1].next.memory;
      c->deeper[at - 1].owed = c->deeper[at - 1].next_owed;
    }
  }
}

/* Transfers each layer to its own flux plus the change of the section. A layer that the block
   before did not have begins as the surface does. */
static void solid_carry(compensator *c, const entry *words, number flux)
{
  const int known = memories_of(c->words);
  const number change = difference(flux, c->flux_applied);
  for (int at = memories_of(words) - 1; at >= 0; at--) {
    const int from = at < known ? at : 0;
    cells_memory *memory = at > 0 ? &c->deeper[at - 1].memory.cells : &c->memory.cells;
    number *plays = at > 0 ? c->deeper[at - 1].plays : c->plays;
    candidate there;
    const number before = stand(c->words, memory_of(c, from), plays_of(c, from), &there);
    for (int cell = 0; cell < ANHYST_CELLS; cell++) {
      plays[cell] = plays_of(c, from)[cell];
    }
    *memory = there.memory.cells;
    carry_memory(c->words, words, inside(sum(before, change)), memory, plays);
    if (at > from) {
      c->deeper[at - 1].owed = 0;
    }
  }
}

static int solid_is_valid(const entry *words)
{
  return is_integer(words[ANHYST_WORD_SOLID_LAYERS], 2, ANHYST_MEMORIES) &&
         memories_of(words) <= ANHYST_MEMORIES && are_solid_words_valid(words);
}
