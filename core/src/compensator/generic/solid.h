/* SPDX-License-Identifier: Apache-2.0 */
/* Solid iron in floating point: layers of one law, from the surface to the middle, with diffusion
   between them. Layer j of N has a share phi_j of the section, S_j is the flux in it and deeper:

     E_j = x_j + own*f_j,   E_{j-1} = E_j + hold*(S_j - S_j,before),   j = 2..N
     current = bias + flux_arm*F + field_arm*(l*E_l(F) + (1 - l)*E_1 - own*F),   F = S_1

   A pass goes in and out again. Inwards all that lies further out is a straight line, by the
   tangents of the layers where they were found last. Outwards each layer meets its line with its
   own law, exactly, from the middle on. What a pass misses is what tangents differ from the law.
   The flux of the whole section is met in any case, and as a tick begins with the fluxes that the
   one before has left, what is missed does not add up. */

/* Passes at most. One does where no layer leaves its segment; after two of them what is left is a
   few 1e-5 of the force, against 1e-4 to 5e-4 after one. */
#define PASSES 2

/* What may be left of the equations, in parts of the largest field in them. */
#define CLOSE (R(64.0) * ANHYST_EPS)

/* The tangent of an iron that all but jumps. */
#define SOFTEST R(1e-9)

/* All memories at one tick: layers from the surface on, then what is laminated. */
typedef struct {
  const anhyst_parameters_x *parameters;
  anhyst_compensator_x *c;
  int flux_given;                         /* whether the flux of the section is known */
  ANHYST_REAL given;                      /* it, or the field that the drive gives */
  ANHYST_REAL reluctance;                 /* of what is around the iron, field for a unit of flux */
  ANHYST_REAL share[ANHYST_MEMORIES];     /* phi_j */
  ANHYST_REAL before[ANHYST_MEMORIES];    /* S_j when the tick began */
  ANHYST_REAL section[ANHYST_MEMORIES];   /* S_j */
  ANHYST_REAL field[ANHYST_MEMORIES];     /* E_j, E_l */
  ANHYST_REAL stiffness[ANHYST_MEMORIES]; /* their slopes over the flux in the layer */
} solid_tick;

/* What lies further out, from one section on: a field, and by how much it falls as the flux of that
   section rises. */
typedef struct {
  ANHYST_REAL field;
  ANHYST_REAL falls;
} solid_line;

static anhyst_memory_x *memory_of(anhyst_compensator_x *c, int at)
{
  return at == 0 ? &c->memory : &c->deeper[at - 1].memory;
}

static anhyst_memory_x *next_of(anhyst_compensator_x *c, int at)
{
  return at == 0 ? &c->next : &c->deeper[at - 1].next;
}

static ANHYST_REAL *plays_of(anhyst_compensator_x *c, int at)
{
  return at == 0 ? c->plays : c->deeper[at - 1].plays;
}

static int memories_of(const anhyst_parameters_x *parameters)
{
  return (int)parameters->solid->layers + (parameters->solid->laminated > R(0.0) ? 1 : 0);
}

/* Takes up field and tangent of a memory; gives its flux. */
static ANHYST_REAL take_up(solid_tick *tick, int at, const anhyst_memory_x *memory)
{
  const anhyst_parameters_x *parameters = tick->parameters;
  const ANHYST_REAL own = parameters->solid->own;
  ANHYST_REAL slope;
  const ANHYST_REAL flux =
      parameters->solid->stand(parameters, memory, plays_of(tick->c, at), &slope);
  tick->field[at] = memory->cells.x + own * flux;
  tick->stiffness[at] = slope + own > SOFTEST * slope ? slope + own : SOFTEST * slope;
  return flux;
}

/* Sections of the state, and where the search sets out: what was solved, or the state. */
static void begin_tick(solid_tick *tick, int from_solved)
{
  anhyst_compensator_x *c = tick->c;
  const anhyst_solid_x *solid = tick->parameters->solid;
  const int layers = (int)solid->layers;
  ANHYST_REAL before = R(0.0);
  ANHYST_REAL now = R(0.0);
  for (int j = layers - 1; j >= 0; j--) {
    tick->share[j] =
        j == 0 ? solid->surface : (R(1.0) - solid->surface) / (ANHYST_REAL)(layers - 1);
    before += tick->share[j] * take_up(tick, j, memory_of(c, j));
    tick->before[j] = before;
    if (from_solved) {
      now += tick->share[j] * take_up(tick, j, next_of(c, j));
    } else {
      now = before;
    }
    tick->section[j] = now;
  }
  if (tick->parameters->solid->laminated > R(0.0)) {
    (void)take_up(tick, layers, from_solved ? next_of(c, layers) : memory_of(c, layers));
  }
}

/* The line that the circuit, and what is laminated, put before the surface. */
static solid_line outside(const solid_tick *tick)
{
  const ANHYST_REAL l = tick->parameters->solid->laminated;
  const int sheets = (int)tick->parameters->solid->layers;
  solid_line line;
  line.field = tick->given - tick->reluctance * tick->section[0];
  line.falls = tick->reluctance;
  if (l > R(0.0)) {
    line.field = (line.field - l * tick->field[sheets]) / (R(1.0) - l);
    line.falls = (line.falls + l * tick->stiffness[sheets]) / (R(1.0) - l);
  }
  return line;
}

/* The line behind a layer, of which the one before it is given; that of the surface where its flux
   is known. */
static solid_line behind(const solid_tick *tick, int layer, solid_line line)
{
  const ANHYST_REAL stiff = tick->stiffness[layer] / tick->share[layer];
  solid_line found = {tick->field[layer], stiff};
  if (layer == 0 && tick->flux_given) {
    found.field += stiff * (tick->given - tick->section[0]);
  } else {
    const ANHYST_REAL part = stiff / (line.falls + stiff);
    found.field += part * (line.field - tick->field[layer]);
    found.falls = part * line.falls;
  }
  const ANHYST_REAL hold = tick->parameters->solid->hold;
  const int next = layer + 1;
  found.field -= hold * (tick->section[next] - tick->before[next]);
  found.falls += hold;
  return found;
}

/* Lets a layer meet its line; the sections below it are new, its own still that of before. */
static void meet_line(solid_tick *tick, int layer, solid_line line, ANHYST_REAL deeper)
{
  const anhyst_parameters_x *parameters = tick->parameters;
  const ANHYST_REAL share = tick->share[layer];
  const anhyst_at_gap_x arms = {R(1.0), R(0.0), R(0.0), parameters->solid->own + line.falls * share,
                                R(1.0)};
  const anhyst_memory_x *from = memory_of(tick->c, layer);
  const ANHYST_REAL *plays = plays_of(tick->c, layer);
  anhyst_memory_x *to = next_of(tick->c, layer);
  (void)parameters->kernel->flux(parameters, from, plays, &arms,
                                 line.field + line.falls * (tick->section[layer] - deeper), to);
  tick->section[layer] = deeper + share * take_up(tick, layer, to);
}

/* Lets a memory meet a flux. */
static void meet_flux(solid_tick *tick, int at, ANHYST_REAL flux)
{
  const anhyst_parameters_x *parameters = tick->parameters;
  anhyst_memory_x *to = next_of(tick->c, at);
  (void)parameters->kernel->field(parameters, memory_of(tick->c, at), plays_of(tick->c, at), flux,
                                  to);
  (void)take_up(tick, at, to);
}

/* Once in and out. */
static void pass(solid_tick *tick)
{
  const int layers = (int)tick->parameters->solid->layers;
  solid_line line[ANHYST_MEMORIES];
  ANHYST_REAL deeper = R(0.0);
  line[0] = outside(tick);
  for (int j = 1; j < layers; j++) {
    line[j] = behind(tick, j - 1, line[j - 1]);
  }
  for (int j = layers - 1; j > 0; j--) {
    meet_line(tick, j, line[j], deeper);
    deeper = tick->section[j];
  }
  if (tick->flux_given) {
    meet_flux(tick, 0, (tick->given - deeper) / tick->share[0]);
    tick->section[0] = tick->given;
  } else {
    meet_line(tick, 0, line[0], deeper);
  }
  if (tick->parameters->solid->laminated > R(0.0)) {
    meet_flux(tick, layers, tick->section[0]);
  }
}

/* Whether the equations are met. */
static int is_met(const solid_tick *tick)
{
  const int layers = (int)tick->parameters->solid->layers;
  ANHYST_REAL most = R(0.0);
  ANHYST_REAL largest = R(0.0);
  for (int j = 1; j < layers; j++) {
    const ANHYST_REAL left = tick->field[j - 1] - tick->field[j] -
                             tick->parameters->solid->hold * (tick->section[j] - tick->before[j]);
    const ANHYST_REAL size =
        anhyst_size_x(tick->field[j - 1]) +
        anhyst_size_x(tick->section[j]) *
            (tick->stiffness[j - 1] / tick->share[j - 1] + tick->parameters->solid->hold);
    largest = size > largest ? size : largest;
    most = anhyst_size_x(left) > most ? anhyst_size_x(left) : most;
  }
  if (!tick->flux_given) {
    const ANHYST_REAL left = outside(tick).field - tick->field[0];
    most = anhyst_size_x(left) > most ? anhyst_size_x(left) : most;
  }
  return most <= CLOSE * largest;
}

static void solve_tick(solid_tick *tick)
{
  for (int i = 0; i < PASSES; i++) {
    pass(tick);
    if (is_met(tick)) {
      return;
    }
  }
}

/* What stands for the field of thin iron in the current, for a flux of the section. */
static ANHYST_REAL solid_field(anhyst_compensator_x *c, ANHYST_REAL flux)
{
  const anhyst_solid_x *solid = c->parameters->solid;
  solid_tick tick;
  tick.parameters = c->parameters;
  tick.c = c;
  tick.flux_given = 1;
  tick.given = flux;
  tick.reluctance = R(0.0);
  begin_tick(&tick, 0);
  solve_tick(&tick);
  ANHYST_REAL field = tick.field[0];
  if (solid->laminated > R(0.0)) {
    field += solid->laminated * (tick.field[solid->layers] - field);
  }
  return field - solid->own * flux;
}

/* The flux of the section that a current leads to. */
static ANHYST_REAL solid_flux(anhyst_compensator_x *c, const anhyst_at_gap_x *row,
                              ANHYST_REAL current)
{
  solid_tick tick;
  tick.parameters = c->parameters;
  tick.c = c;
  tick.flux_given = 0;
  tick.given = (current - row->bias) / row->field_arm;
  tick.reluctance = row->flux_arm / row->field_arm - c->parameters->solid->own;
  begin_tick(&tick, c->solved != 0U);
  solve_tick(&tick);
  return tick.section[0];
}

static int solid_is_valid(const anhyst_parameters_x *parameters)
{
  const anhyst_solid_x *solid = parameters->solid;
  return solid->stand != 0 && solid->layers >= 2U && memories_of(parameters) <= ANHYST_MEMORIES &&
         solid->surface > R(0.0) && solid->surface < R(1.0) && solid->laminated >= R(0.0) &&
         solid->laminated < R(1.0) && solid->hold >= R(0.0) && solid->hold <= R(1e12) &&
         solid->own <= R(0.0) && solid->own >= R(-1e12);
}

#undef PASSES
#undef CLOSE
#undef SOFTEST
