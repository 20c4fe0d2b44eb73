/* SPDX-License-Identifier: Apache-2.0 */

/* Converts a number to an integer of levitation.h. NaN becomes the lowest integer. */
static int32_t number_to_code(ANHYST_REAL a, ANHYST_REAL full)
{
  const ANHYST_REAL fraction = a / full;
  if (!(fraction > R(-1.0))) {
    return ANHYST_Q31_MIN;
  }
  return fraction >= R(1.0) ? ANHYST_Q31_MAX : (int32_t)(fraction * R(2147483648.0));
}

static ANHYST_REAL code_to_number(int32_t code, ANHYST_REAL full)
{
  return (ANHYST_REAL)code / R(2147483648.0) * full;
}

static int32_t position_to_code(const anhyst_position_units_x *units, ANHYST_REAL position)
{
  return number_to_code(position, units->position);
}

static ANHYST_REAL code_to_position(const anhyst_position_units_x *units, int32_t code)
{
  return code_to_number(code, units->position);
}

static int32_t demand_to_code(const anhyst_position_units_x *units, ANHYST_REAL demand)
{
  return number_to_code(demand, units->demand);
}

static ANHYST_REAL code_to_demand(const anhyst_position_units_x *units, int32_t code)
{
  return code_to_number(code, units->demand);
}

/* Returns whether a is in -1e30..1e30. Returns 0 for NaN. */
static int is_number(ANHYST_REAL a)
{
  const ANHYST_REAL largest = R(1e30);
  return a >= -largest && a <= largest;
}

static ANHYST_REAL half(ANHYST_REAL a) { return R(0.5) * a; }

static ANHYST_REAL clamp(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

static ANHYST_REAL position_to_gap(const anhyst_gap_line_x *line, ANHYST_REAL position)
{
  return line->offset + line->factor * position;
}

static ANHYST_REAL round_to_grid(const anhyst_position_limits_x *limits, ANHYST_REAL current)
{
  const ANHYST_REAL low = limits->current_low;
  const int32_t steps = (int32_t)((current - low) / limits->current_step + R(0.5));
  const ANHYST_REAL rounded = low + (ANHYST_REAL)steps * limits->current_step;
  return rounded > limits->current_high ? limits->current_high : rounded;
}

/* Returns whether a range is an integer number of steps, within a quarter of a step. */
static int is_multiple_of_step(ANHYST_REAL range, ANHYST_REAL step)
{
  const ANHYST_REAL steps = range / step;
  if (!(steps >= R(1.0) && steps <= R(1048576.0))) {
    return 0;
  }
  const ANHYST_REAL deviation = steps - (ANHYST_REAL)(int32_t)(steps + R(0.5));
  return deviation >= R(-0.25) && deviation <= R(0.25);
}

static int are_settings_valid(const anhyst_position_limits_x *limits,
                              const anhyst_position_settings_x *settings)
{
  const anhyst_position_units_x *units = &settings->units;
  int are_numbers_valid = is_number(settings->bias) && units->position > R(0.0) &&
                          is_number(units->position) && units->demand > R(0.0) &&
                          is_number(units->demand);
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    are_numbers_valid =
        are_numbers_valid && is_number(units->gap[i].offset) && is_number(units->gap[i].factor);
  }
  return are_numbers_valid && is_number(limits->current_low) && limits->current_step > R(0.0) &&
         is_multiple_of_step(limits->current_high - limits->current_low, limits->current_step) &&
         limits->release >= limits->current_step;
}
