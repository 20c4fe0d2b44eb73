/* SPDX-License-Identifier: Apache-2.0 */
/* Any signals in any order to a compensator in floating point, for a block in block.h. Compiled
   with sanitizers. Exit code 0: every current is a number within the limits, and the memory stays
   finite. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "block.h"

enum { CALLS = 200000, SPECIALS = 14 };

static uint64_t state = 88172645463325252U;

static uint32_t draw(void)
{
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return (uint32_t)(state >> 32);
}

/* A number of some bits, a special one, or one within twice a range. */
static REAL any(REAL low, REAL high)
{
  const REAL special[SPECIALS] = {
      (REAL)NAN, (REAL)INFINITY, -(REAL)INFINITY, 0,       -(REAL)0,    MOST, -MOST,
      LEAST,     -LEAST,         LEAST / 4,       (REAL)1, (REAL)-1e30, low,  high};
  const uint32_t kind = draw() % 8U;
  REAL number;
  if (kind == 0U) {
    const uint64_t bits = (uint64_t)draw() << 32 | draw();
    memcpy(&number, &bits, sizeof number);
    return number;
  }
  if (kind == 1U) {
    return special[draw() % SPECIALS];
  }
  return low + (high - low) * ((REAL)draw() / (REAL)2147483648.0 - (REAL)0.5);
}

static int is_sound(const COMPENSATOR *c, REAL current)
{
  int sound = current >= LOW && current <= HIGH && isfinite(c->flux) && isfinite(c->flux_applied) &&
              isfinite(OUTPUT(c)) && isfinite(c->memory.full.x) && isfinite(c->memory.full.y) &&
              isfinite(c->memory.full.reversal_y);
  for (int i = 0; i < ANHYST_CELLS; i++) {
    sound = sound && isfinite(c->plays[i]);
  }
  return sound;
}

int main(void)
{
  static COMPENSATOR c;
  REAL current = 0;
  if (INIT(&c, &KERNEL, parameters, WORDS) != ANHYST_OK) {
    puts("block refused");
    return 2;
  }
  for (long i = 0; i < CALLS; i++) {
    const uint32_t order = draw() % 16U;
    const REAL gap = any(GAP_LOW, GAP_HIGH);
    if (order < 8U) {
      current = SOLVE(&c, any(-DEMAND, DEMAND), gap);
    } else if (order < 11U) {
      COMMIT(&c, current, gap);
    } else if (order < 14U) {
      COMMIT(&c, any(LOW, HIGH), gap);
    } else if (order == 14U) {
      SWAP(&c, parameters);
    } else if (draw() % 64U == 0U) {
      DEMAGNETISE(&c);
    }
    if (!is_sound(&c, current)) {
      printf("call %ld, kind %u: current %g\n", i, (unsigned)order, (double)current);
      return 1;
    }
  }
  /* At rest, after a rise and after a descent: noise far below a converter's step moves nothing. */
  for (int way = 0; way < 2; way++) {
    REAL first = 0;
    for (int i = 0; i <= 400; i++) {
      const REAL part = (REAL)(way == 0 ? i : 800 - i) / (REAL)800;
      COMMIT(&c, SOLVE(&c, part * DEMAND, GAP_LOW), GAP_LOW);
    }
    for (long i = 0; i < CALLS; i++) {
      const REAL noise = (REAL)1e-4 * ((REAL)draw() / (REAL)2147483648.0 - (REAL)1);
      COMMIT(&c, SOLVE(&c, ((REAL)0.5 + noise) * DEMAND, GAP_LOW), GAP_LOW);
      if (i == 1000) {
        first = SOLVE(&c, (REAL)0.5 * DEMAND, GAP_LOW);
      }
    }
    const REAL crept = SOLVE(&c, (REAL)0.5 * DEMAND, GAP_LOW) - first;
    if (!(crept <= CREEP * (HIGH - LOW) && crept >= -CREEP * (HIGH - LOW))) {
      printf("crept by %g after way %d\n", (double)(crept / (HIGH - LOW)), way);
      return 3;
    }
  }
  return 0;
}
