/* SPDX-License-Identifier: Apache-2.0 */

/* A number over its full scale as an integer of levitation.h; the lowest for what is no number. */
static int32_t to_code(ANHYST_REAL a, ANHYST_REAL full)
{
  const ANHYST_REAL part = a / full;
  if (!(part > R(-1.0))) {
    return ANHYST_Q31_MIN;
  }
  return part >= R(1.0) ? ANHYST_Q31_MAX : (int32_t)(part * R(2147483648.0));
}

static ANHYST_REAL from_code(int32_t code, ANHYST_REAL full)
{
  return (ANHYST_REAL)code / R(2147483648.0) * full;
}

static int32_t position_code(const anhyst_position_units_x *units, ANHYST_REAL position)
{
  return to_code(position, units->position);
}

static ANHYST_REAL position_of(const anhyst_position_units_x *units, int32_t code)
{
  return from_code(code, units->position);
}

static int32_t demand_code(const anhyst_position_units_x *units, ANHYST_REAL demand)
{
  return to_code(demand, units->demand);
}

static ANHYST_REAL demand_of(const anhyst_position_units_x *units, int32_t code)
{
  return from_code(code, units->demand);
}

/* Whether it is a number that can be reckoned with. */
static int is_number(ANHYST_REAL a)
{
  const ANHYST_REAL largest = R(1e30);
  return a >= -largest && a <= largest;
}

static ANHYST_REAL half(ANHYST_REAL a) { return R(0.5) * a; }

/* The lower limit for what is not a number. */
static ANHYST_REAL within(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

static ANHYST_REAL gap_of(const anhyst_gap_line_x *line, ANHYST_REAL position)
{
  return line->offset + line->factor * position;
}

/* The nearest of the converter's currents, for one within the limits. */
static ANHYST_REAL on_grid(const anhyst_position_limits_x *limits, ANHYST_REAL current)
{
  const ANHYST_REAL low = limits->current_low;
  const int32_t steps = (int32_t)((current - low) / limits->current_step + R(0.5));
  const ANHYST_REAL reached = low + (ANHYST_REAL)steps * limits->current_step;
  return reached > limits->current_high ? limits->current_high : reached;
}

/* Whether a range is a whole number of steps, as far as a float can show. */
static int is_whole(ANHYST_REAL range, ANHYST_REAL step)
{
  const ANHYST_REAL steps = range / step;
  if (!(steps >= R(1.0) && steps <= R(1048576.0))) {
    return 0;
  }
  const ANHYST_REAL off = steps - (ANHYST_REAL)(int32_t)(steps + R(0.5));
  return off >= R(-0.25) && off <= R(0.25);
}

static int are_valid(const anhyst_position_limits_x *limits,
                     const anhyst_position_settings_x *settings)
{
  const anhyst_position_units_x *units = &settings->units;
  int numbers = is_number(settings->bias) && units->position > R(0.0) &&
                is_number(units->position) && units->demand > R(0.0) && is_number(units->demand);
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    numbers = numbers && is_number(units->gap[i].offset) && is_number(units->gap[i].factor);
  }
  return numbers && is_number(limits->current_low) && limits->current_step > R(0.0) &&
         is_whole(limits->current_high - limits->current_low, limits->current_step) &&
         limits->release >= limits->current_step;
}
