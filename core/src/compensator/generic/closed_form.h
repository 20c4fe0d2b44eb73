/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the closed form of the simplified law, exact for a step of any size. simplified.h comes
   before it.

   On a rising path p is the bounded state, and v = 1 - p. The distance from p = 0 is
   z = -ln v + nu*v - nu, which grows in proportion to the flux. A table over z gives p. Its
   segments double from octave to octave, because the curve is sharp at z = 0 and flat far out. A
   search in the same table gives z, so that there and back agree. */

/* The bounded state at a distance >= 0. */
static number state_of(const entry *words, number z)
{
  return value_at(spot_at(words, z < DISTANCE_MAX ? z : DISTANCE_MAX));
}

/* The distance at a bounded state of 0..1. */
static number distance_of(const entry *words, number state)
{
  const entry *table = words + (int32_t)words[ANHYST_WORD_SIMPLE_CURVE];
  const int32_t n = (int32_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const int32_t segments = ((int32_t)words[ANHYST_WORD_SIMPLE_OCTAVES] + 1) * ((int32_t)1 << n);
  int32_t index = 0;
  for (int32_t step = (int32_t)8 << n; step > 0; step >>= 1) {
    if (index + step < segments && level_of(table[index + step]) <= state) {
      index += step;
    }
  }
  const number risen = difference(state, level_of(table[index]));
  return distance_at(words, index, part_of(risen, table[index], table[index + 1]));
}

static number start_of(const entry *words, number state)
{
  return state < 0 ? state : distance_of(words, state);
}

static number state_beyond(const entry *words, const simplified_memory *path, number flux)
{
  const number way = difference(flux, path->turn);
  number z = path->start;
  if (path->start < 0) {
    const number held = sum(path->start, held_change(words, way));
    if (held < 0) {
      return held;
    }
    z = -held_distance(words, path->start);
  }
  z = sum(z, distance_on(words, way));
  return state_of(words, z > 0 ? z : 0);
}

static int simplified_is_valid(const entry *words)
{
  const entry octaves = words[ANHYST_WORD_SIMPLE_OCTAVES];
  const entry n = words[ANHYST_WORD_SIMPLE_SEGMENTS];
  return path_is_valid(words) && is_integer(octaves, 4, 14) && is_integer(n, 2, 6) &&
         is_table_rising(words, words[ANHYST_WORD_SIMPLE_CURVE],
                         ((int32_t)octaves + 1) * ((int32_t)1 << (int32_t)n) + 1, 0, ENTRY_ONE);
}
