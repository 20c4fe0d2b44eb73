/* SPDX-License-Identifier: Apache-2.0 */

/* A number over its full scale as an integer of levitation.h; the lowest for what is no number. */
static int32_t ANHYST_NAME(to_code)(ANHYST_REAL a, ANHYST_REAL full)
{
  const ANHYST_REAL part = a / full;
  if (!(part > R(-1.0))) {
    return ANHYST_Q31_MIN;
  }
  return part >= R(1.0) ? ANHYST_Q31_MAX : (int32_t)(part * R(2147483648.0));
}

static ANHYST_REAL ANHYST_NAME(from_code)(int32_t code, ANHYST_REAL full)
{
  return (ANHYST_REAL)code / R(2147483648.0) * full;
}

static int32_t ANHYST_NAME(position_code)(const ANHYST_NAME(anhyst_position_units) *units,
                                          ANHYST_REAL position)
{
  return ANHYST_NAME(to_code)(position, units->position);
}

static ANHYST_REAL ANHYST_NAME(position_of)(const ANHYST_NAME(anhyst_position_units) *units,
                                            int32_t code)
{
  return ANHYST_NAME(from_code)(code, units->position);
}

static int32_t ANHYST_NAME(demand_code)(const ANHYST_NAME(anhyst_position_units) *units,
                                        ANHYST_REAL demand)
{
  return ANHYST_NAME(to_code)(demand, units->demand);
}

static ANHYST_REAL ANHYST_NAME(demand_of)(const ANHYST_NAME(anhyst_position_units) *units,
                                          int32_t code)
{
  return ANHYST_NAME(from_code)(code, units->demand);
}

/* Whether it is a number that can be reckoned with. */
static int ANHYST_NAME(is_number)(ANHYST_REAL a)
{
  const ANHYST_REAL largest = R(1e30);
  return a >= -largest && a <= largest;
}

static ANHYST_REAL ANHYST_NAME(half)(ANHYST_REAL a) { return R(0.5) * a; }

/* The lower limit for what is not a number. */
static ANHYST_REAL ANHYST_NAME(within)(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

static ANHYST_REAL ANHYST_NAME(gap_of)(const ANHYST_NAME(anhyst_gap_line) *line,
                                       ANHYST_REAL position)
{
  return line->offset + line->factor * position;
}

/* The nearest of the converter's currents, for one within the limits. */
static ANHYST_REAL ANHYST_NAME(on_grid)(const ANHYST_NAME(anhyst_position_limits) *limits,
                                        ANHYST_REAL current)
{
  const ANHYST_REAL low = limits->current_low;
  const int32_t steps = (int32_t)((current - low) / limits->current_step + R(0.5));
  const ANHYST_REAL reached = low + (ANHYST_REAL)steps * limits->current_step;
  return reached > limits->current_high ? limits->current_high : reached;
}

/* Whether a range is a whole number of steps, as far as a float can show. */
static int ANHYST_NAME(is_whole)(ANHYST_REAL range, ANHYST_REAL step)
{
  const ANHYST_REAL steps = range / step;
  if (!(steps >= R(1.0) && steps <= R(1048576.0))) {
    return 0;
  }
  const ANHYST_REAL off = steps - (ANHYST_REAL)(int32_t)(steps + R(0.5));
  return off >= R(-0.25) && off <= R(0.25);
}

static int ANHYST_NAME(are_valid)(const ANHYST_NAME(anhyst_position_limits) *limits,
                                  const ANHYST_NAME(anhyst_position_settings) *settings)
{
  const ANHYST_NAME(anhyst_position_units) *units = &settings->units;
  int numbers = ANHYST_NAME(is_number)(settings->bias) && units->position > R(0.0) &&
                ANHYST_NAME(is_number)(units->position) && units->demand > R(0.0) &&
                ANHYST_NAME(is_number)(units->demand);
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    numbers = numbers && ANHYST_NAME(is_number)(units->gap[i].offset) &&
              ANHYST_NAME(is_number)(units->gap[i].factor);
  }
  return numbers && ANHYST_NAME(is_number)(limits->current_low) && limits->current_step > R(0.0) &&
         ANHYST_NAME(is_whole)(limits->current_high - limits->current_low, limits->current_step) &&
         limits->release >= limits->current_step;
}
