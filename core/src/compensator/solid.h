/* SPDX-License-Identifier: Apache-2.0 */
/* Solid iron in fixed point: the way through the layers of a block that has some. */
#ifndef ANHYST_SOLID_H
#define ANHYST_SOLID_H

#include "anhyst/compensator/compensator.h"

#if ANHYST_MEMORIES > 1
/* Layers of a block; 0: thin iron. */
static inline int16_t anhyst_layers_of(const int16_t *words)
{
  return words[ANHYST_WORD_SOLID_LAYERS];
}

/* Whether the words about layers are valid; those of the law must be. */
int anhyst_solid_is_valid(const int16_t *words);

/* What stands for the field of thin iron in the current, q30, for the flux that is solved for; that
   comes down where the surface saturates before it is reached. */
int32_t anhyst_solid_field(anhyst_compensator *c);

/* The flux of the section to which a current leads, q30, at the arms of the compensator. */
int32_t anhyst_solid_flux(anhyst_compensator *c, int32_t current);

/* All layers begin demagnetised, go on with what was found for them, or go on under another
   block. */
void anhyst_solid_start(anhyst_compensator *c);
void anhyst_solid_keep(anhyst_compensator *c);
void anhyst_solid_carry(anhyst_compensator *c, const int16_t *words, int32_t flux);
#endif

#endif
