/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the side of the play for every radius that a block can state: at the largest distances
   within the radius, nothing overflows, and the side keeps its sign. A smaller distance has a
   smaller product. The program is compiled so that an overflow stops it. */
#include "compensator/play_map.c"

int main(void)
{
  int wrong = 0;
  int16_t words[ANHYST_BLOCK_LEAST_WORDS] = {0};
  for (int16_t shift = 0; shift <= 9; shift++) {
    for (int32_t steepness = 16384; steepness <= ANHYST_Q15_MAX; steepness++) {
      law_type law = {{0, 0, 0}, 0, 0, 0, 0};
      words[ANHYST_WORD_PLAY_STEEPNESS] = (int16_t)steepness;
      words[ANHYST_WORD_PLAY_SHIFT] = shift;
      wrong += !read_scales(&law, words) || law.radius < 2097152;
      wrong += branch_position_from_distance(&law, law.radius - 1) < 0 ||
               branch_position_from_distance(&law, 1 - law.radius) > 0;
    }
  }
  return wrong == 0 ? 0 : 1;
}
