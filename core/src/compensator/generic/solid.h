/* SPDX-License-Identifier: Apache-2.0 */
/* Solid core: layers of the play-cell law from the surface to the middle, with eddy-current
   diffusion between them. Template for one number format; generic/cells.h is included before. Layer
   j of N has the fraction phi_j of the cross-section, the flux density f_j and the field E_j. S_j
   is the flux in layer j and all deeper layers:

     E_j = x_j + own*f_j,   E_{j-1} = E_j + hold_j*(S_j - S_j,before),   j = 2..N
     hold_j = hold*(phi_{j-1} + phi_j): proportional to the distance between the middles of layers
     current = bias + flux_arm*F + field_arm*(l*E_l(F) + (1 - l)*E_1 - own*F),   F = S_1

   Each pass goes from the surface to the middle and back. On the way in, the circuit outside of
   each layer is approximated by a load line, which follows from the tangents of the outer layers at
   their last positions. On the way out, each layer solves its own law exactly for its load line.
   The error of a pass is the difference between the tangents and the law. The residual of the last
   pass is added to the next tick as outstanding flux. Without this correction, a slow drive, whose
   flux changes by less than the resolution of a table row per tick, would cause large field errors.

   A slope is the derivative of a field with respect to a flux. Slopes are approximate, and each
   pass checks its result. One pass is sufficient if no layer leaves its segment. If the flux jumps
   within a tick, tangents may alternate between two solutions without converging. Therefore, later
   passes use the secant slope between two distant positions of a layer. */

/* Maximum number of layers of a block. */
#define MAX_LAYERS 4

/* Maximum number of passes, and number of the first passes, which use only tangents. */
#define MAX_PASSES 10
#define TANGENT_PASSES 2

/* Smallest change of a layer's flux for which a secant slope is computed. */
#define MIN_SECANT_FLUX POWER_OF_HALF(7)

/* Smallest total change of flux in a pass that requires another pass. */
#define MIN_FLUX_CHANGE POWER_OF_HALF(19)

/* Error of a flux above which the flux counts as not reached. */
#define MAX_FLUX_ERROR POWER_OF_HALF(14)

/* Maximum outstanding flux of a layer. */
#define MAX_OUTSTANDING_FLUX POWER_OF_HALF(6)

/* All layers in one tick, from the surface inwards, followed by the laminated part. */
typedef struct {
  compensator *c;
  int is_flux_given;                       /* whether the flux is given; otherwise the current */
  int uses_secants;                        /* whether slopes are secants between two positions */
  number target;                           /* given flux, or given current without its bias */
  number diffusion_slope[ANHYST_MEMORIES]; /* hold_j: field outside a layer for a flux change */
  number coupling_slope;                   /* field of a flux in its own layer, <= 0 */
  number reluctance;                       /* field over flux of the circuit outside of the core */
  number field_per_current;                /* 1/(field coefficient*(1 - laminated)) */
  int layers;                              /* N */
  entry laminated;                         /* l */
  entry area_fraction[ANHYST_MEMORIES];    /* phi_j */
  number start_flux[ANHYST_MEMORIES];      /* S_j at the start of the tick */
  number section_flux[ANHYST_MEMORIES];    /* S_j */
  number flux[ANHYST_MEMORIES];            /* flux density of each layer */
  number field[ANHYST_MEMORIES];           /* E_j, E_l */
  number field_slope[ANHYST_MEMORIES];     /* dE_j/dS_j, and dE_l/dF */
  number residual[ANHYST_MEMORIES];        /* residual field between two layers */
} solid_tick;

/* Load line of a section: the field from the circuit outside of the section, which decreases as the
   flux of the section rises. The field is a result of to_coarse_field, because after a jump of the
   flux the field is many times the largest field of the table. */
typedef struct {
  number field;
  number slope; /* decrease of the field over the flux, >= 0 */
} load_line;

static const cells_memory *layer_state(const compensator *c, int layer)
{
  return layer > 0 ? &c->deeper[layer - 1].memory.cells : &c->memory.cells;
}

static candidate *layer_trial(compensator *c, int layer)
{
  return layer > 0 ? &c->deeper[layer - 1].next : &c->next;
}

static const number *layer_plays(const compensator *c, int layer)
{
  return layer > 0 ? c->deeper[layer - 1].plays : c->plays;
}

/* Returns the number of layers of a block, or 0 for a laminated core. */
static int layer_count(const entry *words) { return integer_of(words[ANHYST_WORD_SOLID_LAYERS]); }

static int state_count(const entry *words)
{
  return layer_count(words) + (words[ANHYST_WORD_SOLID_LAMINATED] > 0 ? 1 : 0);
}

/* Returns the flux h*x + m of a trial step. */
static number flux_of_trial(const entry *words, const candidate *trial)
{
  const int mirror = trial->memory.cells.active < 0 ? -1 : 0;
  const number x = mirrored(trial->memory.cells.x, mirror);
  const number rise = multiply_rise(segment_flux_rise(trial, words[ANHYST_WORD_CELLS_AIR]),
                                    fraction_at(x, trial_lower_end(trial, x), trial_grid(trial)));
  return four_times(mirrored(unsafe_sum(trial->of.cells.flux, rise), mirror));
}

/* Sets a trial step to a stored state. Returns the flux of the trial step. */
static number reset_trial(const entry *words, const cells_memory *memory, const number *plays,
                          candidate *trial)
{
  cell_path path;
  begin_path(&path, words, memory, plays);
  path.last_activation = path.x;
  path.segment = locate_field(&path, path.row, path.x).segment;
  trial->of.cells.next_activation = activation_field(&path, path.active, path.x);
  return four_times(store_trial(&path, words, trial));
}

/* Stores the flux and the field of a layer at its trial step. */
static void read_trial(solid_tick *tick, int layer, number flux)
{
  tick->flux[layer] = flux;
  tick->field[layer] =
      sum(layer_trial(tick->c, layer)->memory.cells.x, coupling_field(flux, tick->coupling_slope));
}

static number field_slope_of(const solid_tick *tick, int layer)
{
  const candidate *trial = layer_trial(tick->c, layer);
  const number rise = segment_flux_rise(trial, tick->c->words[ANHYST_WORD_CELLS_AIR]);
  const number slope = segment_field_slope(width_of(trial_grid(trial)), rise, tick->coupling_slope);
  return layer == tick->layers ? slope : divide_slope(slope, tick->area_fraction[layer]);
}

static number add_layer_flux(const solid_tick *tick, int layer, number deeper)
{
  return sum(deeper, times_fraction(tick->flux[layer], tick->area_fraction[layer]));
}

/* Sets the start of a layer's search: a known trial step, otherwise the stored state. */
static void start_search(solid_tick *tick, int layer)
{
  compensator *c = tick->c;
  candidate *trial = layer_trial(c, layer);
  if (c->stage == ANHYST_STAGE_UNKNOWN || !has_segment(trial)) {
    read_trial(tick, layer,
               reset_trial(c->words, layer_state(c, layer), layer_plays(c, layer), trial));
    tick->field_slope[layer] = field_slope_of(tick, layer);
    return;
  }
  if (c->stage == ANHYST_STAGE_HERE) { /* allows the path to reverse at this state */
    const int mirror = trial->memory.cells.active < 0 ? -1 : 0;
    trial->memory.cells.last_activation = saturate(mirrored(trial->memory.cells.x, mirror));
  }
  read_trial(tick, layer, flux_of_trial(c->words, trial));
  const number known_slope = layer > 0 ? c->deeper[layer - 1].stiffness : 0;
  tick->field_slope[layer] = known_slope > 0 ? known_slope : field_slope_of(tick, layer);
}

/* Sets the fractions of the cross-section, and the slopes between the layers. The innermost layer
   has the rest of the cross-section. */
static void set_layer_thickness(solid_tick *tick)
{
  const entry *words = tick->c->words;
  const number hold = read_diffusion_slope(words);
  const int middle = tick->layers - 1;
  entry rest = complement(words[ANHYST_WORD_SOLID_SURFACE]);
  tick->area_fraction[0] = words[ANHYST_WORD_SOLID_SURFACE];
  for (int j = 1; j < middle; j++) {
    tick->area_fraction[j] = words[ANHYST_WORD_SOLID_SECOND + j - 1];
    rest = (entry)(rest - tick->area_fraction[j]);
  }
  tick->area_fraction[middle] = rest;
  for (int j = 1; j <= middle; j++) {
    tick->diffusion_slope[j] =
        at_least_one_lsb(sum(times_fraction(hold, tick->area_fraction[j - 1]),
                             times_fraction(hold, tick->area_fraction[j])));
  }
}

/* Sets the flux of each section, and the start of each layer's search. */
static void init_solid_tick(solid_tick *tick, compensator *c)
{
  const entry *words = c->words;
  const int layers = layer_count(words);
  number section_flux = 0;
  tick->c = c;
  tick->layers = layers;
  tick->laminated = words[ANHYST_WORD_SOLID_LAMINATED];
  tick->coupling_slope = read_coupling_slope(words);
  set_layer_thickness(tick);
  for (int j = layers - 1; j > 0; j--) {
    start_search(tick, j);
    section_flux = add_layer_flux(tick, j, section_flux);
    tick->section_flux[j] = section_flux;
    if (c->stage != ANHYST_STAGE_AHEAD) {
      c->deeper[j - 1].start_flux = sum(section_flux, c->deeper[j - 1].flux_deficit);
    }
    tick->start_flux[j] = c->deeper[j - 1].start_flux;
  }
  start_search(tick, 0);
  tick->section_flux[0] = add_layer_flux(tick, 0, section_flux);
  if (tick->laminated > 0) {
    start_search(tick, layers);
  }
}

/* Returns the uniform field that would need the same current in a laminated core at this flux. */
static number equivalent_field(const solid_tick *tick)
{
  number field = tick->field[0];
  if (tick->laminated > 0) {
    field =
        sum(field, times_fraction(difference(tick->field[tick->layers], field), tick->laminated));
  }
  return difference(field, coupling_field(tick->section_flux[0], tick->coupling_slope));
}

static void set_circuit_slopes(solid_tick *tick)
{
  const arms_type *arms = &tick->c->arms;
  tick->field_per_current = field_slope_of_current(arms->field_arm, tick->laminated);
  tick->reluctance = -tick->coupling_slope;
  if (arms->flux_arm > 0) {
    tick->reluctance = sum(tick->reluctance, divide_weights(arms->flux_arm, arms->field_arm));
  } else if (arms->flux_arm < 0) {
    tick->reluctance =
        difference(tick->reluctance, divide_weights(-arms->flux_arm, arms->field_arm));
  }
}

/* Returns the target current minus the current of the present fields and fluxes. */
static number residual_current(const solid_tick *tick)
{
  const arms_type *arms = &tick->c->arms;
  const number present = sum(scaled(tick->section_flux[0], arms->flux_arm),
                             scaled(equivalent_field(tick), arms->field_arm));
  return difference(tick->target, present);
}

/* Returns the slope of the load line at the surface (decrease of the field over the flux, >= 0). */
static number circuit_slope(const solid_tick *tick)
{
  number reluctance = tick->reluctance;
  if (tick->laminated > 0) {
    reluctance = sum(reluctance, times_fraction(tick->field_slope[tick->layers], tick->laminated));
  }
  return reluctance > 0 ? divide_slope_by_solid(reluctance, tick->laminated) : 0;
}

/* Returns the load line at the surface, from the circuit and the laminated part. */
static load_line load_line_at_surface(const solid_tick *tick)
{
  load_line line;
  line.field =
      sum(to_coarse_field(tick->field[0]),
          multiply_by_slope(to_coarse_field(residual_current(tick)), tick->field_per_current));
  line.slope = circuit_slope(tick);
  return line;
}

/* Returns the load line inside a layer, from that outside or from a given flux at the surface. */
static load_line load_line_below_layer(const solid_tick *tick, int layer, load_line line)
{
  const number slope = tick->field_slope[layer];
  const number field = to_coarse_field(tick->field[layer]);
  load_line below = {field, slope};
  if (layer == 0 && tick->is_flux_given) {
    const number change = difference(tick->target, tick->section_flux[0]);
    below.field = sum(field, multiply_by_slope(to_coarse_field(change), slope));
  } else {
    const entry fraction = slope_fraction(slope, line.slope);
    below.field = sum(field, times_fraction(difference(line.field, field), fraction));
    below.slope = times_fraction(line.slope, fraction);
  }
  const number change = difference(tick->section_flux[layer + 1], tick->start_flux[layer + 1]);
  const number diffusion_slope = tick->diffusion_slope[layer + 1];
  below.field =
      difference(below.field, multiply_by_slope(to_coarse_field(change), diffusion_slope));
  below.slope = sum(below.slope, diffusion_slope);
  return below;
}

/* Returns the new slope of a layer that has left its segment, from the previous flux and field. */
static number updated_field_slope(const solid_tick *tick, int layer, number flux, number field)
{
  const number change = difference(tick->flux[layer], flux);
  if (!tick->uses_secants || absolute(change) < MIN_SECANT_FLUX) {
    return field_slope_of(tick, layer);
  }
  const number slope = secant_slope(difference(tick->field[layer], field), change);
  return layer == tick->layers ? slope : divide_slope(slope, tick->area_fraction[layer]);
}

/* Solves a layer for a target, divided by 4, with the given coefficients. */
static void solve_layer(solid_tick *tick, int layer, const arms_type *arms, number target)
{
  compensator *c = tick->c;
  candidate *trial = layer_trial(c, layer);
  const int32_t segment = trial->of.cells.segment;
  const number flux = tick->flux[layer];
  const number field = tick->field[layer];
  (void)solve_current(c->words, layer_state(c, layer), layer_plays(c, layer), arms, target, trial,
                      1);
  read_trial(tick, layer, flux_of_trial(c->words, trial));
  if (trial->of.cells.segment != segment) {
    tick->field_slope[layer] = updated_field_slope(tick, layer, flux, field);
  }
}

static void solve_layer_for_flux(solid_tick *tick, int layer, number flux)
{
  const arms_type arms = {0, QUARTER_WEIGHT, 0};
  solve_layer(tick, layer, &arms, quarter(quarter(flux)));
}

/* Solves a layer for its load line. The load line refers to the previous flux of the section, so
   that the change of the deeper section is subtracted. */
static void solve_layer_for_load_line(solid_tick *tick, int layer, load_line line, number changed)
{
  const number line_slope = times_fraction(line.slope, tick->area_fraction[layer]);
  const number field =
      difference(line.field, multiply_by_slope(to_coarse_field(changed), line.slope));
  arms_type arms;
  const number target =
      set_load_line(&arms, field, line_slope, tick->coupling_slope, tick->flux[layer]);
  solve_layer(tick, layer, &arms, target);
}

/* Runs one pass inwards and outwards. Returns the sum of the flux changes of all sections. */
static number run_pass(solid_tick *tick)
{
  const int layers = tick->layers;
  const number start_flux = tick->section_flux[0];
  number flux_change = 0;
  load_line line[ANHYST_MEMORIES];
  number deeper = 0;
  number changed = 0;
  line[0].field = 0;
  line[0].slope = 0;
  if (!tick->is_flux_given) {
    line[0] = load_line_at_surface(tick);
  }
  for (int j = 1; j < layers; j++) {
    line[j] = load_line_below_layer(tick, j - 1, line[j - 1]);
  }
  for (int j = layers - 1; j > 0; j--) {
    solve_layer_for_load_line(tick, j, line[j], changed);
    deeper = add_layer_flux(tick, j, deeper);
    changed = difference(deeper, tick->section_flux[j]);
    flux_change = sum(flux_change, absolute(changed));
    tick->section_flux[j] = deeper;
  }
  if (tick->is_flux_given) {
    solve_layer_for_flux(
        tick, 0, divide_by_fraction(difference(tick->target, deeper), tick->area_fraction[0]));
  } else {
    solve_layer_for_load_line(tick, 0, line[0], changed);
  }
  tick->section_flux[0] = add_layer_flux(tick, 0, deeper);
  if (tick->laminated > 0) {
    solve_layer_for_flux(tick, layers, tick->section_flux[0]);
  }
  return sum(flux_change, absolute(difference(tick->section_flux[0], start_flux)));
}

/* Returns whether all equations are solved except for rounding errors. Sets the residuals. */
static int are_equations_solved(solid_tick *tick)
{
  int result = 1;
  for (int j = 1; j < tick->layers; j++) {
    const number change = difference(tick->section_flux[j], tick->start_flux[j]);
    const number field_drop = difference(tick->field[j - 1], tick->field[j]);
    tick->residual[j] = difference(field_drop, multiply_by_slope(change, tick->diffusion_slope[j]));
    if (!is_residual_small(tick->residual[j],
                           sum(tick->field_slope[j - 1], tick->diffusion_slope[j]))) {
      result = 0;
    }
  }
  if (result && !tick->is_flux_given) {
    return is_residual_small(multiply_by_slope(residual_current(tick), tick->field_per_current),
                             circuit_slope(tick));
  }
  return result;
}

static void solve_layers(solid_tick *tick)
{
  for (int i = 0; i < MAX_PASSES; i++) {
    tick->uses_secants = i >= TANGENT_PASSES;
    const number flux_change = run_pass(tick);
    if (are_equations_solved(tick) || flux_change < MIN_FLUX_CHANGE) { /* or saturated surface */
      break;
    }
  }
  for (int j = 1; j < tick->layers; j++) {
    tick->c->deeper[j - 1].next_flux_deficit =
        outstanding_flux(tick->diffusion_slope[j], tick->residual[j], MAX_OUTSTANDING_FLUX);
  }
  for (int j = 1; j < state_count(tick->c->words); j++) {
    tick->c->deeper[j - 1].stiffness = tick->field_slope[j];
  }
}

/* Returns the uniform field that would need the same current in a laminated core at this flux.
   Reduces c->flux if the surface saturates at a smaller flux. */
static number solid_field_for_flux(compensator *c)
{
  solid_tick tick;
  init_solid_tick(&tick, c);
  tick.is_flux_given = 1;
  tick.target = c->flux;
  solve_layers(&tick);
  const number residual = difference(tick.section_flux[0], c->flux);
  if (residual > MAX_FLUX_ERROR || residual < -MAX_FLUX_ERROR) {
    c->flux = saturate(tick.section_flux[0]);
    c->flags |= ANHYST_FLUX_LIMITED;
  }
  return saturate(equivalent_field(&tick));
}

/* Returns the flux of the whole cross-section for a current. */
static number solid_flux_for_current(compensator *c, number current)
{
  solid_tick tick;
  init_solid_tick(&tick, c);
  set_circuit_slopes(&tick);
  tick.is_flux_given = 0;
  tick.target = difference(current, c->arms.bias);
  solve_layers(&tick);
  return tick.section_flux[0];
}

/* Sets all layers to the initial state of the surface layer. */
static void solid_init_state(compensator *c)
{
  cells_init_state(c);
  for (int i = 0; i < ANHYST_MEMORIES - 1; i++) {
    c->deeper[i].memory = c->memory;
    c->deeper[i].next = c->next;
    c->deeper[i].flux_deficit = 0;
    c->deeper[i].next_flux_deficit = 0;
    for (int cell = 0; cell < ANHYST_CELLS; cell++) {
      c->deeper[i].plays[cell] = c->plays[cell];
    }
  }
}

static void solid_store_state(compensator *c)
{
  for (int layer = state_count(c->words) - 1; layer >= 0; layer--) {
    number *plays = layer > 0 ? c->deeper[layer - 1].plays : c->plays;
    if (have_reversed(layer_state(c, layer), &layer_trial(c, layer)->memory.cells)) {
      store_active_plays(c->words, layer_state(c, layer), plays);
    }
    if (layer > 0) {
      c->deeper[layer - 1].memory = c->deeper[layer - 1].next.memory;
      c->deeper[layer - 1].flux_deficit = c->deeper[layer - 1].next_flux_deficit;
    }
  }
}

/* Transfers each layer to its old flux plus the change of the total flux. A layer that does not
   exist in the old block gets the state of the surface layer. */
static void solid_transfer_state(compensator *c, const entry *words, number flux)
{
  const int old_memories = state_count(c->words);
  const number change = difference(flux, c->flux_applied);
  for (int layer = state_count(words) - 1; layer >= 0; layer--) {
    const int from = layer < old_memories ? layer : 0;
    cells_memory *memory = layer > 0 ? &c->deeper[layer - 1].memory.cells : &c->memory.cells;
    number *plays = layer > 0 ? c->deeper[layer - 1].plays : c->plays;
    candidate trial;
    const number old_flux =
        reset_trial(c->words, layer_state(c, from), layer_plays(c, from), &trial);
    for (int cell = 0; cell < ANHYST_CELLS; cell++) {
      plays[cell] = layer_plays(c, from)[cell];
    }
    *memory = trial.memory.cells;
    transfer_state(c->words, words, saturate(sum(old_flux, change)), memory, plays);
    if (layer > from) {
      c->deeper[layer - 1].flux_deficit = 0;
    }
  }
}

/* Returns whether each layer has at least the smallest fraction of the cross-section. Unused words
   must be 0. */
static int are_area_fractions_valid(const entry *words)
{
  const int layers = layer_count(words);
  entry rest = words[ANHYST_WORD_SOLID_SURFACE];
  if (!(rest >= (entry)MIN_AREA_FRACTION && rest <= complement((entry)MIN_AREA_FRACTION))) {
    return 0;
  }
  rest = complement(rest);
  for (int j = 1; j < MAX_LAYERS - 1; j++) {
    const entry fraction = words[ANHYST_WORD_SOLID_SECOND + j - 1];
    if (j < layers - 1) {
      if (!(fraction >= (entry)MIN_AREA_FRACTION &&
            fraction <= (entry)(rest - (entry)MIN_AREA_FRACTION))) {
        return 0;
      }
      rest = (entry)(rest - fraction);
    } else if (fraction != 0) {
      return 0;
    }
  }
  return 1;
}

static int are_solid_layers_valid(const entry *words)
{
  return is_integer(words[ANHYST_WORD_SOLID_LAYERS], 2,
                    ANHYST_MEMORIES < MAX_LAYERS ? ANHYST_MEMORIES : MAX_LAYERS) &&
         state_count(words) <= ANHYST_MEMORIES && are_solid_words_valid(words) &&
         are_area_fractions_valid(words);
}
