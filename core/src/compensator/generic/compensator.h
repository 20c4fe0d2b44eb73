/* SPDX-License-Identifier: Apache-2.0 */
#if ANHYST_MEMORIES > 1
#include "solid.h"
#endif

/* State that changes: at most 224 bytes for thin iron, in either precision. */
typedef char anhyst_state_is_small_x
    [sizeof(anhyst_compensator_x) <= 224U + (ANHYST_MEMORIES - 1U) * 176U ? 1 : -1];

/* The row of this gap, interpolated. */
static anhyst_at_gap_x at_gap(const anhyst_parameters_x *parameters, ANHYST_REAL gap)
{
  const anhyst_spot_x spot = anhyst_spot_of_x(parameters->gap_segments,
                                              (gap - parameters->gap_low) * parameters->gap_rows);
  const anhyst_at_gap_x *low = parameters->gaps + spot.index;
  const anhyst_at_gap_x *high = low + 1;
  anhyst_at_gap_x row;
  row.gain = low->gain + spot.part * (high->gain - low->gain);
  row.offset = low->offset + spot.part * (high->offset - low->offset);
  row.bias = low->bias + spot.part * (high->bias - low->bias);
  row.flux_arm = low->flux_arm + spot.part * (high->flux_arm - low->flux_arm);
  row.field_arm = low->field_arm + spot.part * (high->field_arm - low->field_arm);
  return row;
}

/* Root of a number that is not negative, meant for 0..1. Below the knee a straight line; from
   there to 1 a relative error below one unit in the last place of a float and 1e-14 in double
   precision. */
static ANHYST_REAL root(ANHYST_REAL a, ANHYST_REAL knee)
{
  if (a < knee * knee) {
    return a / knee;
  }
  /* Into 1/4..1 by even powers of two, which are exact; the least knee is 2^-8. */
  ANHYST_REAL scale = R(0.5);
  if (a < R(0.00390625)) {
    a *= R(256.0);
    scale *= R(0.0625);
  }
  if (a < R(0.0625)) {
    a *= R(16.0);
    scale *= R(0.25);
  }
  if (a < R(0.25)) {
    a *= R(4.0);
    scale *= R(0.5);
  }
  /* A line within 3 % to begin with; each step doubles the digits. */
  ANHYST_REAL r = R(0.686) * a + R(0.343);
  r = R(0.5) * (r + a / r);
  r = R(0.5) * (r + a / r);
  return scale * (r + a / r);
}

/* The demand as a flux. */
static ANHYST_REAL flux_of(anhyst_compensator_x *c, ANHYST_REAL demand, const anhyst_at_gap_x *row)
{
  const anhyst_parameters_x *parameters = c->parameters;
  const ANHYST_REAL wanted =
      anhyst_limited_x(demand, parameters->demand_low, parameters->demand_high);
  ANHYST_REAL part = (wanted - row->offset) / parameters->full_scale;
  if (wanted != demand) {
    c->flags |= ANHYST_DEMAND_LIMITED;
  }
  if (parameters->power == 2U) {
    if (part < R(0.0)) {
      part = R(0.0);
      c->flags |= ANHYST_DEMAND_LIMITED;
    }
    part = root(part, parameters->knee);
  }
  const ANHYST_REAL flux = part * row->gain;
  const ANHYST_REAL reached =
      anhyst_limited_x(flux, -parameters->flux_limit, parameters->flux_limit);
  if (reached != flux) {
    c->flags |= ANHYST_FLUX_LIMITED;
  }
  return reached;
}

/* Whether limits are in order and finite. */
static int is_range(ANHYST_REAL low, ANHYST_REAL high)
{
  const ANHYST_REAL largest = R(1e30);
  return low <= high && low >= -largest && high <= largest;
}

static int rows_is_valid(const anhyst_parameters_x *parameters)
{
  for (uint16_t i = 0; i <= parameters->gap_segments; i++) {
    const anhyst_at_gap_x *row = parameters->gaps + i;
    if (!(row->gain > R(0.0) && row->field_arm > R(0.0) && is_range(row->gain, row->gain) &&
          is_range(row->offset, row->offset) && is_range(row->bias, row->bias) &&
          is_range(row->flux_arm, row->flux_arm) && is_range(row->field_arm, row->field_arm))) {
      return 0;
    }
  }
  return 1;
}

/* What stands for the field in the current: that of the law, unless the iron is solid. */
static ANHYST_REAL field_for(anhyst_compensator_x *c, ANHYST_REAL flux)
{
  const anhyst_parameters_x *parameters = c->parameters;
#if ANHYST_MEMORIES > 1
  if (parameters->solid != 0) {
    return solid_field(c, flux);
  }
#endif
  return parameters->kernel->field(parameters, &c->memory, c->plays, flux, &c->next);
}

/* The flux to which a current leads. */
static ANHYST_REAL flux_under(anhyst_compensator_x *c, const anhyst_at_gap_x *row,
                              ANHYST_REAL current)
{
  const anhyst_parameters_x *parameters = c->parameters;
#if ANHYST_MEMORIES > 1
  if (parameters->solid != 0) {
    return solid_flux(c, row, current);
  }
#endif
  return parameters->kernel->flux(parameters, &c->memory, c->plays, row, current, &c->next);
}

/* Goes on with the memory after a step. */
static void keep(const anhyst_parameters_x *parameters, anhyst_memory_x *memory, ANHYST_REAL *plays,
                 const anhyst_memory_x *next)
{
  if (parameters->kernel->keep != 0) {
    parameters->kernel->keep(parameters, memory, next, plays);
  }
  *memory = *next;
}

anhyst_status anhyst_parameters_check_x(const anhyst_parameters_x *parameters)
{
  const int valid = parameters->kernel != 0 && parameters->gaps != 0 &&
                    (parameters->power == 1U || parameters->power == 2U) &&
                    is_range(parameters->demand_low, parameters->demand_high) &&
                    is_range(parameters->current_low, parameters->current_high) &&
                    is_range(parameters->gap_low, parameters->gap_low) &&
                    is_range(R(0.0), parameters->gap_rows) && parameters->full_scale > R(0.0) &&
                    parameters->knee >= R(0.00390625) && parameters->knee <= R(0.25) &&
                    parameters->flux_limit > R(0.0) && parameters->flux_limit <= R(1e6) &&
                    parameters->gap_segments >= 1U && parameters->gap_segments <= 64U &&
                    parameters->condition_cycles <= 64U && parameters->condition_ticks >= 2U &&
                    parameters->condition_ticks <= 32767U;
  if (!valid || !rows_is_valid(parameters) || !parameters->kernel->valid(parameters)) {
    return ANHYST_BAD_PARAMETER;
  }
#if ANHYST_MEMORIES > 1
  if (parameters->solid != 0 && !solid_is_valid(parameters)) {
    return ANHYST_BAD_PARAMETER;
  }
#endif
  return ANHYST_OK;
}

anhyst_status anhyst_compensator_init_x(anhyst_compensator_x *c,
                                        const anhyst_parameters_x *parameters)
{
  const anhyst_compensator_x fresh = {0};
  const anhyst_status status = anhyst_parameters_check_x(parameters);
  if (status != ANHYST_OK) {
    return status;
  }
  *c = fresh;
  c->parameters = parameters;
  return ANHYST_OK;
}

void anhyst_compensator_swap_x(anhyst_compensator_x *c, const anhyst_parameters_x *parameters)
{
  parameters->kernel->carry(c->parameters, &c->memory, c->plays);
#if ANHYST_MEMORIES > 1
  for (int i = 0; c->parameters->solid != 0 && i < ANHYST_MEMORIES - 1; i++) {
    parameters->kernel->carry(c->parameters, &c->deeper[i].memory, c->deeper[i].plays);
  }
#endif
  c->parameters = parameters;
  c->solved = 0;
}

ANHYST_REAL anhyst_compensator_solve_x(anhyst_compensator_x *c, ANHYST_REAL demand, ANHYST_REAL gap)
{
  const anhyst_parameters_x *parameters = c->parameters;
  const anhyst_at_gap_x row = at_gap(parameters, gap);
  c->flags = 0;
  c->gap = gap;
  c->flux = flux_of(c, demand, &row);
  const ANHYST_REAL field = field_for(c, c->flux);
  const ANHYST_REAL wanted = row.bias + row.flux_arm * c->flux + row.field_arm * field;
  c->current = anhyst_limited_x(wanted, parameters->current_low, parameters->current_high);
  c->solved = 1;
  if (c->current != wanted) {
    c->flags |= ANHYST_CURRENT_LIMITED;
    c->solved = 0;
  }
  return c->current;
}

void anhyst_compensator_commit_x(anhyst_compensator_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  const anhyst_parameters_x *parameters = c->parameters;
  if (c->solved != 0U && applied == c->current && gap == c->gap) {
    c->flux_applied = c->flux;
  } else {
    const anhyst_at_gap_x row = at_gap(parameters, gap);
    c->flux_applied = flux_under(c, &row, applied);
    c->gap = gap;
  }
  keep(parameters, &c->memory, c->plays, &c->next);
#if ANHYST_MEMORIES > 1
  for (int i = 0; parameters->solid != 0 && i < memories_of(parameters) - 1; i++) {
    anhyst_deeper_x *deeper = &c->deeper[i];
    keep(parameters, &deeper->memory, deeper->plays, &deeper->next);
  }
#endif
  c->solved = 0;
}

ANHYST_REAL
anhyst_compensator_output_x(const anhyst_compensator_x *c)
{
  const anhyst_parameters_x *parameters = c->parameters;
  const anhyst_at_gap_x row = at_gap(parameters, c->gap);
  ANHYST_REAL part = c->flux_applied / row.gain;
  if (parameters->power == 2U) {
    const ANHYST_REAL magnitude = anhyst_size_x(part);
    part = magnitude * (magnitude < parameters->knee ? parameters->knee : magnitude);
  }
  return part * parameters->full_scale + row.offset;
}

int32_t anhyst_conditioning_length_x(const anhyst_compensator_x *c)
{
  return (int32_t)c->parameters->condition_cycles * 2 * c->parameters->condition_ticks;
}

ANHYST_REAL anhyst_conditioning_x(const anhyst_compensator_x *c, int32_t tick)
{
  const int32_t ramp = c->parameters->condition_ticks;
  const ANHYST_REAL low = c->parameters->current_low;
  const ANHYST_REAL span = c->parameters->current_high - low;
  if (tick < 0 || tick >= anhyst_conditioning_length_x(c)) {
    return R(0.0);
  }
  const int32_t place = tick % (2 * ramp);
  const int32_t way = place < ramp ? place : 2 * ramp - place;
  return low + span * (ANHYST_REAL)way / (ANHYST_REAL)ramp;
}
