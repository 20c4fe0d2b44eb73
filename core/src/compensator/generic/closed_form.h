/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the closed form of the simplified law, exact for a step of any size. simplified.h is
   included before. On a path with rising flux, p is the hysteresis field u, and v = 1 - p. The
   distance from p = 0 is z = -ln v + nu*v - nu, which rises in proportion to the flux. A table
   contains p as a function of z. The segment width doubles from octave to octave, because the curve
   is steep at z = 0 and flat at large z. A search in the same table gives z for p. */

static number state_at_distance(const entry *words, number z)
{
  return table_value(locate_distance(words, z < MAX_DISTANCE ? z : MAX_DISTANCE));
}

static number distance_at_state(const entry *words, number state)
{
  const entry *table = words + (int32_t)words[ANHYST_WORD_SIMPLE_CURVE];
  const int32_t n = (int32_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const int32_t segments = ((int32_t)words[ANHYST_WORD_SIMPLE_OCTAVES] + 1) * ((int32_t)1 << n);
  int32_t index = 0;
  for (int32_t step = (int32_t)8 << n; step > 0; step >>= 1) {
    if (index + step < segments && word_value(table[index + step]) <= state) {
      index += step;
    }
  }
  const number rise_up_to_state = difference(state, word_value(table[index]));
  return distance_at_fraction(words, index,
                              fraction_at_rise(rise_up_to_state, table[index], table[index + 1]));
}

static number stored_path_start(const entry *words, number state)
{
  return state < 0 ? state : distance_at_state(words, state);
}

static number state_at_flux(const entry *words, const simplified_memory *path, number flux)
{
  const number travel = difference(flux, path->start_flux);
  number z = path->start_state;
  if (path->start_state < 0) {
    const number linear_state = sum(path->start_state, linear_state_change(words, travel));
    if (linear_state < 0) {
      return linear_state;
    }
    z = -linear_distance(words, path->start_state);
  }
  z = sum(z, distance_of_travel(words, travel));
  return state_at_distance(words, z > 0 ? z : 0);
}

static int is_simplified_block_valid(const entry *words)
{
  const entry octaves = words[ANHYST_WORD_SIMPLE_OCTAVES];
  const entry n = words[ANHYST_WORD_SIMPLE_SEGMENTS];
  return are_path_words_valid(words) && is_integer(octaves, 4, 14) && is_integer(n, 2, 6) &&
         is_table_rising(words, words[ANHYST_WORD_SIMPLE_CURVE],
                         ((int32_t)octaves + 1) * ((int32_t)1 << (int32_t)n) + 1, 0, ENTRY_ONE);
}
