/* SPDX-License-Identifier: Apache-2.0 */
/* Runs bodies with magnets of an identified law and of irons of every family under sanitizers.
 *
 * The bodies have one or six coordinates and receive random commands of any size. Each run prints a
 * checksum of all bits of its results. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "anhyst_plant/body.h"
#include "anhyst_plant/held.h"

#define CELLS 25
#define POINTS 5
#define TICKS 3000
#define NODES 33
#define MOST 10 /* magnets */

enum { OF_CELLS, OF_LAW, OF_PREISACH, OF_DUHEM, SOLID, CONE, KINDS };
static const char *const kinds[KINDS] = {"cells", "law", "preisach", "duhem", "solid", "cone"};

/* Pole width of the other magnets, with a cone that saturates. */
static const anhyst_plant_cone cone = {1e-8, 0.011, 0.5, 0.05, 0.4e-3, 6e-4, 2e-4, 1e-3, 0.45, 1.7};

/* Preisach iron, in eight volumes over a quarter of the path. */
static anhyst_plant_solid solid;

static const double psi[2 * POINTS] = {0.0, 0.04, 0.07, 0.09, 0.1, 0.0, 0.02, 0.04, 0.055, 0.065};
static const anhyst_plant_row rows[2] = {{8e3, 4e-3, 60.0, 0.1, 0.02, 1.0},
                                         {6e3, 6e-3, 60.0, 0.1, 0.02, 1.0}};

static const anhyst_plant_curve curve = {1.3, 120.0, 0.75, 3000.0};

static double everett[NODES * NODES];

static void make_cells(anhyst_plant_iron *iron)
{
  int i;
  iron->family = &anhyst_plant_of_cells;
  iron->steel.cells.cells = CELLS;
  for (i = 0; i < CELLS; i++) {
    iron->steel.cells.threshold[i] = 12.0 * (double)i;
    iron->steel.cells.weight[i] = 1.0 / (double)CELLS;
  }
  iron->steel.cells.curve = curve;
}

/* Relays spread evenly over the cells of the table. */
static void make_preisach(anhyst_plant_iron *iron)
{
  const anhyst_plant_curve reversible = {0.1, 300.0, 0.5, 3000.0};
  int i;
  int j;
  for (i = 0; i < NODES; i++) {
    for (j = 0; j < NODES; j++) {
      const double away = (double)(j - i) / (double)(NODES - 1);
      everett[i * NODES + j] = 2.4 * away * fabs(away);
    }
  }
  iron->family = &anhyst_plant_of_preisach;
  iron->steel.preisach.everett = everett;
  iron->steel.preisach.nodes = NODES;
  iron->steel.preisach.knee = 150.0;
  iron->steel.preisach.reach = 0.8;
  iron->steel.preisach.feedback = 10.0;
  iron->steel.preisach.curve = reversible;
  iron->slack = 40.0;
}

static void make_duhem(anhyst_plant_iron *iron)
{
  iron->family = &anhyst_plant_of_duhem;
  iron->steel.duhem.curve = curve;
  iron->steel.duhem.coercivity = 80.0;
  iron->steel.duhem.rate = 5.0;
  iron->steel.duhem.fading = 0.6;
  iron->slack = 320.0;
}

static void make_circuit(anhyst_plant_circuit *c, int kind)
{
  memset(c, 0, sizeof *c);
  if (kind == OF_PREISACH || kind == SOLID) {
    make_preisach(&c->iron);
  } else if (kind == OF_DUHEM) {
    make_duhem(&c->iron);
  } else {
    make_cells(&c->iron);
  }
  c->iron_length = 0.2;
  c->iron_area = 0.016 * 0.014;
  c->pole_width = 0.016;
  c->pole_depth = 0.014;
  c->leakage = 1.2e-8;
  c->eddy = 10.0;
  if (kind == CONE) {
    c->joints = 2e5;
    c->cone = &cone;
  }
  if (kind == SOLID) {
    int j;
    solid.volumes = 8;
    solid.part = 0.25;
    for (j = 0; j < solid.volumes; j++) {
      solid.share[j] = 0.125;
      solid.drag[j] = j == 0 ? 2.0 : 4.0;
    }
    c->solid = &solid;
  }
}

static anhyst_plant_sensor sensor(double low, double high, int delay)
{
  anhyst_plant_sensor s = {0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5, 0};
  s.low = low;
  s.high = high;
  s.step = (high - low) / 65535.0;
  s.noise = 10.0 * s.step;
  s.delay = delay;
  return s;
}

static anhyst_plant_actuator actuators[MOST];
static anhyst_plant_head heads[6];

static void make_actuator(anhyst_plant_actuator *a, const anhyst_plant_magnet *magnet,
                          int by_current)
{
  const anhyst_plant_amplifier amplifier = {150.0,
                                            by_current ? 300.0 : 0.0,
                                            by_current ? 5e5 : 0.0,
                                            by_current ? 0.0 : -150.0,
                                            by_current ? 4.5 : 150.0,
                                            1e-4};
  memset(a, 0, sizeof *a);
  a->magnet = *magnet;
  a->amplifier = amplifier;
  a->current_sensor = sensor(-0.5, 5.0, 3);
  a->flux_probe = sensor(-2.0, 2.0, 1);
  a->has_probe = 1;
}

/* Settings common to all bodies: one coordinate, the gap of the first magnet. */
static void make_body(anhyst_plant_body *b, int magnets, int substeps)
{
  const anhyst_plant_coordinate gap = {0, 0.55e-3, 0.0, 0.35e-3, 0.55e-3, 2e8, 2e4};
  int j;
  memset(b, 0, sizeof *b);
  b->magnets = magnets;
  b->actuator = actuators;
  b->coordinates = 1;
  b->coordinate[0] = gap;
  b->heads = 1;
  b->head = heads;
  memset(heads, 0, sizeof heads);
  heads[0].line.d[0] = 1.0;
  heads[0].sensor = sensor(0.0, 1e-3, 0);
  for (j = 0; j < magnets; j++) {
    actuators[j].line.d[0] = j == 0 ? -1.0 : 1.0;
    actuators[j].gap_zero = j == 0 ? 0.0 : 0.9e-3;
  }
  b->load.line.d[0] = 1.0;
  b->load.share = 0.04;
  b->load.encoder_step = 50e-9;
  b->load.velocity_share = 0.06;
  b->load.stiffness = 1e4;
  b->load.rest = 0.45e-3;
  b->mass = 2.0;
  b->tick = 50e-6;
  b->substeps = substeps;
  b->delay = ANHYST_PLANT_MAX_DELAY / 2;
  b->force_along[0] = -1.0;
  b->force_sensor = sensor(-500.0, 500.0, ANHYST_PLANT_MAX_DELAY - 1);
}

/* Six coordinates: pairs along x and y, four magnets from above, a displaced centre of mass. */
static void make_stage(anhyst_plant_body *b)
{
  static const anhyst_plant_line lines[MOST] = {
      {{0.15, 0.12, -0.005}, {1.0, 0.0, 0.0}},  {{-0.15, 0.12, -0.005}, {-1.0, 0.0, 0.0}},
      {{0.15, -0.12, -0.005}, {1.0, 0.0, 0.0}}, {{-0.15, -0.12, -0.005}, {-1.0, 0.0, 0.0}},
      {{0.0, 0.15, 0.0}, {0.0, 1.0, 0.0}},      {{0.0, -0.15, 0.0}, {0.0, -1.0, 0.0}},
      {{0.12, 0.12, 0.05}, {0.0, 0.0, 1.0}},    {{-0.12, 0.12, 0.05}, {0.0, 0.0, 1.0}},
      {{-0.12, -0.12, 0.05}, {0.0, 0.0, 1.0}},  {{0.12, -0.12, 0.05}, {0.0, 0.0, 1.0}}};
  int j;
  make_body(b, MOST, 4);
  b->coordinates = 6;
  b->heads = 6;
  for (j = 0; j < 6; j++) {
    const anhyst_plant_coordinate way = {j, 0.0, 40.0, -0.1e-3, 0.1e-3, 2e8, 2e4};
    b->coordinate[j] = way;
    heads[j].line = lines[j + (j > 3 ? 2 : 0)];
    heads[j].sensor = sensor(-1e-3, 1e-3, j);
    heads[j].base = j % 2 ? ANHYST_PLANT_GROUND : ANHYST_PLANT_FRAME;
  }
  for (j = 0; j < 3; j++) {
    b->coordinate[3 + j].stop_stiffness = 2e6;
    b->coordinate[3 + j].stop_damping = 2e2;
    b->inertia[j][j] = 0.2;
  }
  b->inertia[0][1] = b->inertia[1][0] = 0.01;
  b->centre[0] = 1e-3;
  b->centre[2] = -4e-3;
  b->gravity[2] = -9.81;
  b->mass = 20.0;
  b->cable.at[1] = 0.14;
  b->cable.stiffness = 500.0;
  b->cable.damping = 5.0;
  for (j = 0; j < MOST; j++) {
    actuators[j].line = lines[j];
    actuators[j].gap_zero = 0.45e-3;
  }
}

/* Returns a pseudo-random command, equal in every run. */
static double command(unsigned *seed)
{
  static const double extremes[4] = {1e300, -1e300, HUGE_VAL, 0.0};
  *seed = *seed * 1664525U + 1013904223U;
  if (*seed >> 28U == 0U) {
    return extremes[(*seed >> 20U) & 3U];
  }
  return 5.0 * (double)(*seed >> 8U) / 16777216.0;
}

/* Adds the bytes of a number to an FNV-1a checksum, lowest byte first. */
static void add(uint64_t *hash, double value)
{
  uint64_t bits;
  int i;
  memcpy(&bits, &value, sizeof bits);
  for (i = 0; i < 8; i++) {
    *hash = (*hash ^ ((bits >> (8 * i)) & 0xFFU)) * UINT64_C(0x100000001B3);
  }
}

static int run(const anhyst_plant_body *b, const char *name, int ticks)
{
  static anhyst_plant_actuator_state own[MOST];
  static anhyst_plant_head_state seen[6];
  static anhyst_plant_memory volumes[MOST][ANHYST_PLANT_MAX_VOLUMES];
  static anhyst_plant_state state;
  double head[6];
  double current[MOST];
  double density[MOST];
  anhyst_plant_readings r = {head, current, density, 0.0};
  uint64_t hash = UINT64_C(0xCBF29CE484222325);
  unsigned seed = 1;
  int tick;
  int j;
  state.actuator = own;
  state.head = seen;
  if (!anhyst_plant_start(b, &state, 7)) {
    return 1;
  }
  memset(volumes, 0, sizeof volumes);
  for (j = 0; j < b->magnets; j++) {
    own[j].coil.volume = volumes[j];
  }
  for (tick = 0; tick < ticks; tick++) {
    double commands[MOST];
    const int drawn = b->magnets < 2 ? 2 : b->magnets;
    for (j = 0; j < drawn; j++) {
      commands[j] = command(&seed);
    }
    anhyst_plant_read(b, &state, &r);
    anhyst_plant_advance(b, &state, commands, 100.0 * (command(&seed) > 2.0 ? 2.0 : 1.0));
    add(&hash, head[0]);
    add(&hash, current[0]);
    add(&hash, density[0]);
    for (j = 0; j < b->coordinates; j++) {
      add(&hash, state.pose[j]);
    }
    add(&hash, state.force);
    for (j = 0; j < b->magnets; j++) {
      if (!(isfinite(current[j]) && isfinite(density[j]) && isfinite(own[j].coil.force) &&
            own[j].gap > 0.2e-3 && own[j].gap < 0.7e-3)) {
        (void)printf("%s: tick %d: magnet %d, gap %g\n", name, tick, j, own[j].gap);
        return 1;
      }
    }
  }
  (void)printf("ok %s, %016llx\n", name, (unsigned long long)hash);
  return 0;
}

/* An armature that is moved between 0.2 and 0.7 mm while its amplifier receives random commands. */
static int run_held(const anhyst_plant_magnet *magnet, const char *name, double seconds)
{
  static anhyst_plant_held_state state;
  static anhyst_plant_memory volumes[ANHYST_PLANT_MAX_VOLUMES];
  const anhyst_plant_held held = {
      *magnet, seconds, 0.0,
      4.5,     1e-3,    0.6,
      0.5,     0.01,    {sensor(0.0, 1e-3, 0), sensor(-500.0, 1000.0, 2), sensor(-0.5, 5.0, 1)}};
  uint64_t hash = UINT64_C(0xCBF29CE484222325);
  unsigned seed = 3;
  int tick;
  int j;
  memset(&state, 0, sizeof state);
  memset(volumes, 0, sizeof volumes);
  state.coil.volume = volumes;
  for (tick = 0; tick < TICKS; tick++) {
    const double gap = 0.45e-3 + 0.25e-3 * ((double)(tick % 200) / 100.0 - 1.0);
    const double noise[ANHYST_HELD_SENSORS] = {1e-7 * command(&seed), command(&seed), 0.0};
    double row[ANHYST_HELD_COLUMN_COUNT];
    anhyst_plant_held_tick(&held, &state, command(&seed), gap, noise, row);
    for (j = 0; j < ANHYST_HELD_COLUMN_COUNT; j++) {
      if (!isfinite(row[j])) {
        return 1;
      }
      add(&hash, row[j]);
    }
  }
  (void)printf("ok %s, held, %016llx\n", name, (unsigned long long)hash);
  return 0;
}

int main(void)
{
  static anhyst_plant_circuit circuits[KINDS];
  anhyst_plant_law law;
  anhyst_operator_f64 operator;
  anhyst_iron_f64 iron;
  int failed = 0;
  int choice;
  int j;
  memset(&law, 0, sizeof law);
  if (anhyst_iron_init_f64(&iron, &operator, ANHYST_STEP_LINEAR, 1.3e6, 400.0, 300.0, 0.15, 0.0,
                           0.0, 0) != ANHYST_OK) {
    return 1;
  }
  law.iron = &iron;
  law.rows = rows;
  law.row_count = 2;
  law.eddy = 1.0;
  law.table.psi = psi;
  law.table.currents = POINTS;
  law.table.gaps = 2;
  law.table.current_high = 4.0;
  law.table.gap_low = 0.3e-3;
  law.table.gap_high = 0.6e-3;
  for (choice = 0; choice < 4 * KINDS; choice++) {
    const int kind = choice / 2 % KINDS;
    const int pair = choice / 2 / KINDS;
    const int by_current = choice % 2;
    anhyst_plant_body body;
    anhyst_plant_magnet magnet;
    char name[40];
    memset(&magnet, 0, sizeof magnet);
    magnet.turns = 250.0;
    magnet.resistance = 1.2;
    if (kind == OF_LAW) {
      magnet.law = &law;
    } else {
      make_circuit(&circuits[kind], kind);
      magnet.circuit = &circuits[kind];
    }
    for (j = 0; j < MOST; j++) {
      make_actuator(&actuators[j], &magnet, by_current);
    }
    if (pair && !by_current && !magnet.law) {
      failed += run_held(&magnet, kinds[kind], kind == SOLID ? 1e-3 : 0.0);
    }
    make_body(&body, pair ? 2 : 1, pair ? 4 : 1);
    (void)snprintf(name, sizeof name, "%s, %d magnets, %s", kinds[kind], body.magnets,
                   by_current ? "current" : "voltage");
    failed += run(&body, name, TICKS);
    if (pair) {
      make_stage(&body);
      (void)snprintf(name, sizeof name, "%s, six axes, %s", kinds[kind],
                     by_current ? "current" : "voltage");
      failed += run(&body, name, TICKS / 10);
    }
  }
  return failed;
}
