/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/body.h"

#include <math.h>
#include <string.h>

#define AXES ANHYST_PLANT_AXES
#define DELAY_INDEX_MASK (ANHYST_PLANT_MAX_DELAY - 1U)

/* Resistance of an open circuit divided by that of the winding. */
#define OPEN_CIRCUIT_RATIO 100.0

static double dot(const double a[3], const double b[3])
{
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double result[3])
{
  result[0] = a[1] * b[2] - a[2] * b[1];
  result[1] = a[2] * b[0] - a[0] * b[2];
  result[2] = a[0] * b[1] - a[1] * b[0];
}

static void lever_arm(const anhyst_plant_line *line, const double *pose, double result[3])
{
  const double arm[3] = {line->r[0] - pose[0], line->r[1] - pose[1], line->r[2] - pose[2]};
  cross(arm, line->d, result);
}

/* Returns the displacement along a line. Skips the angles if the body cannot rotate. */
static inline double displacement_along(const anhyst_plant_line *line, const double *pose,
                                        int can_turn)
{
  const double translation = dot(line->d, pose);
  double arm[3];
  if (!can_turn) {
    return translation;
  }
  lever_arm(line, pose, arm);
  return translation + dot(arm, pose + 3);
}

double anhyst_plant_displacement(const anhyst_plant_line *line, const double pose[AXES])
{
  return displacement_along(line, pose, 1);
}

/* Adds the wrench of a force along a line. Skips the moment if the body cannot rotate. */
static inline void add_force_along(const anhyst_plant_line *line, const double *pose, double force,
                                   int can_turn, double wrench[AXES])
{
  double rotated_d[3] = {0.0, 0.0, 0.0};
  if (can_turn) {
    double arm[3];
    cross(pose + 3, line->d, rotated_d);
    lever_arm(line, pose, arm);
    wrench[3] += arm[0] * force;
    wrench[4] += arm[1] * force;
    wrench[5] += arm[2] * force;
  }
  wrench[0] += (line->d[0] + rotated_d[0]) * force;
  wrench[1] += (line->d[1] + rotated_d[1]) * force;
  wrench[2] += (line->d[2] + rotated_d[2]) * force;
}

/* Solves a*x = b in place. Returns 0 if a leading minor of the matrix is not positive. */
static inline int solve_linear(int n, double a[AXES][AXES], double b[AXES])
{
  int i;
  int j;
  int k;
  if (n < 1 || n > AXES) {
    return 0;
  }
  for (k = 0; k < n; k++) {
    if (!(a[k][k] > 0.0)) {
      return 0;
    }
    for (i = k + 1; i < n; i++) {
      const double part = a[i][k] / a[k][k];
      for (j = k + 1; j < n; j++) {
        a[i][j] -= part * a[k][j];
      }
      b[i] -= part * b[k];
    }
  }
  for (k = n - 1; k >= 0; k--) {
    for (j = k + 1; j < n; j++) {
      b[k] -= a[k][j] * b[j];
    }
    b[k] /= a[k][k];
  }
  return 1;
}

/* Sets the mass matrix of all six axes about the reference point of the pose. With c the centre of
   mass, the matrix is [m, -m[c x]; m[c x], J - m[c x][c x]]. */
static void mass_matrix(const anhyst_plant_body *body, double m[AXES][AXES])
{
  const double *c = body->centre;
  const double cross_matrix[3][3] = {{0.0, -c[2], c[1]}, {c[2], 0.0, -c[0]}, {-c[1], c[0], 0.0}};
  int i;
  int j;
  memset(m, 0, sizeof(double[AXES][AXES]));
  for (i = 0; i < 3; i++) {
    m[i][i] = body->mass;
    for (j = 0; j < 3; j++) {
      m[3 + i][j] = body->mass * cross_matrix[i][j];
      m[j][3 + i] = m[3 + i][j];
      m[3 + i][3 + j] = body->inertia[i][j] + body->mass * dot(cross_matrix[i], cross_matrix[j]);
    }
  }
}

/* Sets the velocity changes of half a sub-step. Returns 0 if the mass matrix is not positive. */
static int set_mobility(const anhyst_plant_body *body, anhyst_plant_state *state)
{
  const double half = 0.5 * (body->tick / (double)body->substeps);
  const int n = body->coordinates;
  double mass[AXES][AXES];
  int i;
  int k;
  mass_matrix(body, mass);
  for (k = 0; k < n; k++) {
    double free_mass[AXES][AXES];
    double column[AXES] = {0.0};
    for (i = 0; i < n; i++) {
      int j;
      for (j = 0; j < n; j++) {
        free_mass[i][j] = mass[body->coordinate[i].axis][body->coordinate[j].axis];
      }
    }
    column[k] = half;
    if (!solve_linear(n, free_mass, column)) {
      return 0;
    }
    for (i = 0; i < n; i++) {
      state->ease[i][k] = column[i];
    }
  }
  return 1;
}

/* Sets the coupling of the free coordinates by a cable: J'*J, where u = J*(P, th). */
static void set_cable_matrix(const anhyst_plant_body *body, anhyst_plant_state *state)
{
  const double *c = body->cable.at;
  const double moved[AXES][3] = {{1.0, 0.0, 0.0},    {0.0, 1.0, 0.0},    {0.0, 0.0, 1.0},
                                 {0.0, -c[2], c[1]}, {c[2], 0.0, -c[0]}, {-c[1], c[0], 0.0}};
  int k;
  int l;
  for (k = 0; k < body->coordinates; k++) {
    for (l = 0; l < body->coordinates; l++) {
      state->tie[k][l] = dot(moved[body->coordinate[k].axis], moved[body->coordinate[l].axis]);
    }
  }
}

/* Returns the force of a cable of 1 N/m on a free coordinate for a displacement. With a velocity
   instead, it is the damping force of a cable of 1 N s/m. */
static double cable_force(const anhyst_plant_body *body, const anhyst_plant_state *state, int k,
                          const double *displacement)
{
  double sum = 0.0;
  int l;
  for (l = 0; l < body->coordinates; l++) {
    sum += state->tie[k][l] * displacement[body->coordinate[l].axis];
  }
  return sum;
}

static double read_encoder(const anhyst_plant_body *body, const anhyst_plant_state *state)
{
  const double at = displacement_along(&body->load.line, state->pose, state->can_turn);
  const double step = body->load.encoder_step;
  return step > 0.0 ? floor(at / step + 0.5) * step : at;
}

static void absolute_pose(const anhyst_plant_state *state, double pose[AXES])
{
  int i;
  for (i = 0; i < AXES; i++) {
    pose[i] = state->pose[i] + state->frame[i];
  }
}

static double head_position(const anhyst_plant_head *head, const anhyst_plant_state *state)
{
  double pose[AXES];
  if (head->base != ANHYST_PLANT_GROUND) {
    return head->zero + displacement_along(&head->line, state->pose, state->can_turn);
  }
  absolute_pose(state, pose);
  return head->zero + displacement_along(&head->line, pose, state->can_turn);
}

static inline void sum_magnet_forces(const anhyst_plant_body *body, anhyst_plant_state *state)
{
  double *wrench = state->wrench;
  int j;
  for (j = 0; j < AXES; j++) {
    wrench[j] = 0.0;
  }
  for (j = 0; j < body->magnets; j++) {
    add_force_along(&body->actuator[j].line, state->pose, state->actuator[j].coil.force,
                    state->can_turn, wrench);
  }
  state->force = dot(body->force_along, wrench);
}

static void find_gaps(const anhyst_plant_body *body, anhyst_plant_state *state)
{
  int j;
  for (j = 0; j < body->magnets; j++) {
    const anhyst_plant_actuator *actuator = &body->actuator[j];
    state->actuator[j].gap =
        actuator->gap_zero - displacement_along(&actuator->line, state->pose, state->can_turn);
  }
}

static void start_head(const anhyst_plant_body *body, anhyst_plant_state *state, int j)
{
  state->head[j].position = head_position(&body->head[j], state);
  anhyst_plant_sensor_start(&state->head[j].sensing, state->head[j].position);
}

static void settle_sensors(const anhyst_plant_body *body, anhyst_plant_state *state)
{
  int j;
  find_gaps(body, state);
  state->load_position = read_encoder(body, state);
  for (j = 0; j < body->heads; j++) {
    start_head(body, state, j);
  }
}

int anhyst_plant_start(const anhyst_plant_body *body, anhyst_plant_state *state, uint64_t seed)
{
  anhyst_plant_actuator_state *actuators = state->actuator;
  anhyst_plant_head_state *heads = state->head;
  int j;
  memset(state, 0, sizeof *state);
  state->actuator = actuators;
  state->head = heads;
  for (j = 0; j < body->coordinates; j++) {
    state->pose[body->coordinate[j].axis] = body->coordinate[j].rest;
    state->can_turn |= body->coordinate[j].axis >= 3;
  }
  for (j = 0; j < body->magnets; j++) {
    memset(&actuators[j], 0, sizeof actuators[j]);
    anhyst_plant_sensor_start(&actuators[j].current_sensing, 0.0);
    anhyst_plant_sensor_start(&actuators[j].flux_sensing, 0.0);
  }
  anhyst_plant_noise_start(&state->noise, seed);
  anhyst_plant_sensor_start(&state->force_sensing, 0.0);
  settle_sensors(body, state);
  set_cable_matrix(body, state);
  for (j = 0; j < 3; j++) {
    state->weight[j] = body->mass * body->gravity[j];
  }
  cross(body->centre, state->weight, state->weight + 3);
  return set_mobility(body, state);
}

void anhyst_plant_place(const anhyst_plant_body *body, anhyst_plant_state *state,
                        const double *pose, const double *velocity)
{
  int k;
  for (k = 0; k < body->coordinates; k++) {
    state->pose[body->coordinate[k].axis] = pose[k];
    state->velocity[body->coordinate[k].axis] = velocity[k];
  }
  settle_sensors(body, state);
}

void anhyst_plant_ride(const anhyst_plant_body *body, anhyst_plant_state *state,
                       const double *frame)
{
  int j;
  for (j = 0; j < body->coordinates; j++) {
    state->frame[body->coordinate[j].axis] = frame[j];
  }
  for (j = 0; j < body->heads; j++) {
    if (body->head[j].base == ANHYST_PLANT_GROUND) {
      start_head(body, state, j);
    }
  }
}

void anhyst_plant_hold(const anhyst_plant_body *body, anhyst_plant_state *state, int j,
                       double current)
{
  const anhyst_plant_actuator *actuator = &body->actuator[j];
  anhyst_plant_actuator_state *magnet_state = &state->actuator[j];
  const double voltage = actuator->magnet.resistance * current;
  anhyst_plant_coil_lead(&actuator->magnet, &magnet_state->coil, current, magnet_state->gap, 0.0);
  if (actuator->amplifier.gain > 0.0) {
    magnet_state->coil.integral = voltage;
    magnet_state->output = current;
  } else {
    magnet_state->output = voltage;
  }
  sum_magnet_forces(body, state);
  anhyst_plant_sensor_start(&magnet_state->current_sensing, current);
  if (actuator->has_probe <= ANHYST_PLANT_HALL) {
    anhyst_plant_sensor_start(&magnet_state->flux_sensing, magnet_state->coil.density);
  }
  magnet_state->psi_start = magnet_state->coil.psi;
  anhyst_plant_sensor_start(&state->force_sensing, state->force);
}

void anhyst_plant_read(const anhyst_plant_body *body, anhyst_plant_state *state,
                       anhyst_plant_readings *readings)
{
  anhyst_plant_noise *noise = &state->noise;
  int j;
  for (j = 0; j < body->heads; j++) {
    readings->head[j] =
        anhyst_plant_sensor_read(&body->head[j].sensor, &state->head[j].sensing, noise);
  }
  for (j = 0; j < body->magnets; j++) {
    const anhyst_plant_actuator *actuator = &body->actuator[j];
    const anhyst_plant_actuator_state *magnet_state = &state->actuator[j];
    readings->current[j] =
        anhyst_plant_sensor_read(&actuator->current_sensor, &magnet_state->current_sensing, noise);
    readings->density[j] =
        actuator->has_probe
            ? anhyst_plant_sensor_read(&actuator->flux_probe, &magnet_state->flux_sensing, noise)
            : (double)NAN;
  }
  readings->force = anhyst_plant_sensor_read(&body->force_sensor, &state->force_sensing, noise);
}

static inline void step_magnet(const anhyst_plant_actuator *actuator,
                               anhyst_plant_actuator_state *state, double seconds)
{
  const anhyst_plant_amplifier *amplifier = &actuator->amplifier;
  const double current = state->coil.current;
  const double density = state->coil.density;
  anhyst_plant_source source = {0.0, 0.0, 0.0, 0.0, 0.0};
  source.limit = amplifier->limit;
  if (amplifier->gain > 0.0) {
    source.reference = state->output;
    source.gain = amplifier->gain;
    source.reset = amplifier->reset;
  } else {
    source.voltage = state->output;
  }
  if (state->failure != ANHYST_PLANT_WORKS) {
    const double open_gain =
        amplifier->gain > 0.0 ? amplifier->gain : OPEN_CIRCUIT_RATIO * actuator->magnet.resistance;
    source.reference = source.reset = source.voltage = state->coil.integral = 0.0;
    source.gain = state->failure == ANHYST_PLANT_OPEN ? open_gain : 0.0;
  }
  anhyst_plant_coil_step(&actuator->magnet, &state->coil, &source, state->gap, seconds);
  if (actuator->has_probe == ANHYST_PLANT_WINDING) {
    state->area += 0.5 * seconds * actuator->magnet.resistance * (current + state->coil.current);
  }
  anhyst_plant_sensor_follow(&actuator->current_sensor, &state->current_sensing, current,
                             state->coil.current);
  if (actuator->has_probe <= ANHYST_PLANT_HALL) {
    anhyst_plant_sensor_follow(&actuator->flux_probe, &state->flux_sensing, density,
                               state->coil.density);
  }
}

/* Measures the mean voltage of the coil that senses the flux. Its sensor has no low-pass. */
static void measure_voltage(const anhyst_plant_actuator *actuator,
                            anhyst_plant_actuator_state *state, double seconds)
{
  if (actuator->has_probe > ANHYST_PLANT_HALL) {
    const double induced = state->coil.psi - state->psi_start;
    const double area = actuator->has_probe == ANHYST_PLANT_WINDING
                            ? induced + state->area
                            : actuator->sense_turns * induced;
    const double mean = area / seconds;
    anhyst_plant_sensor_follow(&actuator->flux_probe, &state->flux_sensing, mean, mean);
  }
  state->psi_start = state->coil.psi;
  state->area = 0.0;
}

/* Forces along the free coordinates without the damping forces, and damping coefficients. */
typedef struct {
  double force[AXES];
  double damping[AXES];
  int is_damped; /* whether a damping coefficient is above zero */
} axis_forces;

static inline void find_forces(const anhyst_plant_body *body, const anhyst_plant_state *state,
                               int n, axis_forces *result)
{
  double load_wrench[AXES] = {0.0};
  int k;
  add_force_along(&body->load.line, state->pose, state->load, state->can_turn, load_wrench);
  result->is_damped = body->cable.damping > 0.0;
  for (k = 0; k < n; k++) {
    const anhyst_plant_coordinate *c = &body->coordinate[k];
    const int axis = c->axis;
    const double at = state->pose[axis];
    const double stop_overlap = at > c->stop_high  ? at - c->stop_high
                                : at < c->stop_low ? at - c->stop_low
                                                   : 0.0;
    double damping = c->damping;
    if (stop_overlap > 0.0 || stop_overlap < 0.0) {
      damping += c->stop_damping;
    }
    result->damping[k] = damping;
    result->is_damped |= damping > 0.0;
    result->force[k] = load_wrench[axis] + state->weight[axis] + state->wrench[axis] -
                       c->stop_stiffness * stop_overlap +
                       damping * state->frame_velocity[axis]; /* the damper moves with the frame */
  }
  if (body->cable.stiffness > 0.0) {
    double pose[AXES];
    absolute_pose(state, pose);
    for (k = 0; k < n; k++) {
      result->force[k] -= body->cable.stiffness * cable_force(body, state, k, pose);
    }
  }
}

/* Advances the velocity by the first half of a sub-step, with the damping force at its start. */
static inline void start_half_step(const anhyst_plant_body *body, anhyst_plant_state *state, int n,
                                   const axis_forces *forces)
{
  double force[AXES];
  int k;
  int l;
  for (l = 0; l < n; l++) {
    force[l] = forces->force[l];
    if (forces->is_damped) {
      force[l] -= forces->damping[l] * state->velocity[body->coordinate[l].axis];
    }
    if (body->cable.damping > 0.0) {
      force[l] -= body->cable.damping * cable_force(body, state, l, state->velocity);
    }
  }
  for (k = 0; k < n; k++) {
    double velocity = state->velocity[body->coordinate[k].axis];
    for (l = 0; l < n; l++) {
      velocity += state->ease[k][l] * force[l];
    }
    state->velocity[body->coordinate[k].axis] = velocity;
  }
}

/* Returns the relative velocity change by the damping of a cable in half a sub-step. */
static double cable_damping_term(const anhyst_plant_body *body, const anhyst_plant_state *state,
                                 int k, int l)
{
  double sum = 0.0;
  int i;
  for (i = 0; body->cable.damping > 0.0 && i < body->coordinates; i++) {
    sum += state->ease[k][i] * body->cable.damping * state->tie[i][l];
  }
  return sum;
}

/* Advances the velocity by the second half, with the damping force at its end: (1 + ease*damping)*v
   = v + ease*force. */
static inline void end_half_step(const anhyst_plant_body *body, anhyst_plant_state *state, int n,
                                 const axis_forces *forces)
{
  double matrix[AXES][AXES];
  double velocity[AXES];
  int k;
  int l;
  for (k = 0; k < n; k++) {
    velocity[k] = state->velocity[body->coordinate[k].axis];
    for (l = 0; l < n; l++) {
      velocity[k] += state->ease[k][l] * forces->force[l];
      matrix[k][l] = (k == l ? 1.0 : 0.0) + state->ease[k][l] * forces->damping[l] +
                     cable_damping_term(body, state, k, l);
    }
  }
  if (forces->is_damped) { /* without damping, the matrix is the identity */
    (void)solve_linear(n, matrix, velocity);
  }
  for (k = 0; k < n; k++) {
    state->velocity[body->coordinate[k].axis] = velocity[k];
  }
}

/* Advances by one sub-step. The forces on entry are those at its start, on return at its end. */
static inline void run_substep(const anhyst_plant_body *body, anhyst_plant_state *state, int n,
                               double seconds, double load_command, axis_forces *forces)
{
  const double force = state->force;
  int j;
  if (state->due[state->at]) {
    for (j = 0; j < body->magnets; j++) {
      state->actuator[j].output = state->actuator[j].line[state->at];
    }
    state->due[state->at] = 0;
  }
  state->at = (state->at + 1U) & DELAY_INDEX_MASK;
  start_half_step(body, state, n, forces);
  for (j = 0; j < n; j++) {
    const int axis = body->coordinate[j].axis;
    state->pose[axis] += seconds * (state->velocity[axis] - state->frame_velocity[axis]);
    state->frame[axis] += seconds * state->frame_velocity[axis];
  }
  find_gaps(body, state);
  for (j = 0; j < body->magnets; j++) {
    step_magnet(&body->actuator[j], &state->actuator[j], seconds);
  }
  sum_magnet_forces(body, state);
  state->load += body->load.share * (load_command - state->load);
  find_forces(body, state, n, forces);
  end_half_step(body, state, n, forces);
  for (j = 0; j < body->heads; j++) {
    const double last_position = state->head[j].position;
    state->head[j].position = head_position(&body->head[j], state);
    anhyst_plant_sensor_follow(&body->head[j].sensor, &state->head[j].sensing, last_position,
                               state->head[j].position);
  }
  anhyst_plant_sensor_follow(&body->force_sensor, &state->force_sensing, force, state->force);
}

/* Advances by the sub-steps of one tick. n is the number of free coordinates. For a single
   coordinate the caller passes a constant 1, so that the compiler removes the loops. */
static inline void run_substeps(const anhyst_plant_body *body, anhyst_plant_state *state, int n,
                                double load_command)
{
  const double seconds = body->tick / (double)body->substeps;
  axis_forces forces;
  int j;
  find_forces(body, state, n, &forces);
  for (j = 0; j < body->substeps; j++) {
    run_substep(body, state, n, seconds, load_command, &forces);
  }
}

void anhyst_plant_advance(const anhyst_plant_body *body, anhyst_plant_state *state,
                          const double *command, double load)
{
  const unsigned due = (state->at + (unsigned)body->delay) & DELAY_INDEX_MASK;
  const anhyst_plant_load *drive = &body->load; /* the load's state controller runs first */
  const double position = read_encoder(body, state);
  const double velocity = (position - state->load_position) / body->tick;
  double load_command;
  int j;
  state->load_velocity += drive->velocity_share * (velocity - state->load_velocity);
  state->load_position = position;
  load_command =
      load - drive->damping * state->load_velocity - drive->stiffness * (position - drive->rest);
  for (j = 0; j < body->magnets; j++) {
    const anhyst_plant_amplifier *amplifier = &body->actuator[j].amplifier;
    state->actuator[j].line[due] =
        anhyst_plant_convert(command[j], amplifier->low, amplifier->high, amplifier->step);
  }
  state->due[due] = 1;
  if (body->coordinates == 1) {
    run_substeps(body, state, 1, load_command);
  } else {
    run_substeps(body, state, body->coordinates, load_command);
  }
  for (j = 0; j < body->magnets; j++) {
    measure_voltage(&body->actuator[j], &state->actuator[j], body->tick);
  }
}
