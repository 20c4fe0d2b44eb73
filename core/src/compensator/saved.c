/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>

#include "formats/fixed.h"

typedef anhyst_saved_memory saved_memory;
typedef anhyst_saved_layer saved_layer;

#include "generic/saved.h"

void anhyst_compensator_save(const anhyst_compensator *c, anhyst_saved_memory *to)
{
  save_state(c, to);
}

anhyst_status anhyst_compensator_restore(anhyst_compensator *c, const anhyst_saved_memory *from)
{
  return restore_state(c, from);
}
