/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>

#include "formats/f64.h"

typedef anhyst_saved_memory_f64 saved_memory;
typedef anhyst_saved_layer_f64 saved_layer;

#include "generic/saved.h"

void anhyst_compensator_save_f64(const anhyst_compensator_f64 *c, anhyst_saved_memory_f64 *to)
{
  save_state(c, to);
}

anhyst_status anhyst_compensator_restore_f64(anhyst_compensator_f64 *c,
                                             const anhyst_saved_memory_f64 *from)
{
  return restore_state(c, from);
}
