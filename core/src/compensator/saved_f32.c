/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>

#include "formats/f32.h"

typedef anhyst_saved_memory_f32 saved_memory;
typedef anhyst_saved_layer_f32 saved_layer;

#include "generic/saved.h"

void anhyst_compensator_save_f32(const anhyst_compensator_f32 *c, anhyst_saved_memory_f32 *to)
{
  save_state(c, to);
}

anhyst_status anhyst_compensator_restore_f32(anhyst_compensator_f32 *c,
                                             const anhyst_saved_memory_f32 *from)
{
  return restore_state(c, from);
}
