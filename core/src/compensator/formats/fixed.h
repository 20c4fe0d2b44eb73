/* SPDX-License-Identifier: Apache-2.0 */
/* Types of the fixed-point format, for the templates of the laws in ../generic. */
#ifndef ANHYST_FORMAT_FIXED_H
#define ANHYST_FORMAT_FIXED_H

#include "anhyst/compensator/compensator.h"

typedef int32_t number; /* a field, a flux, a current */
typedef int16_t entry;  /* a word of a block */
typedef anhyst_arms arms_type;
typedef anhyst_candidate candidate;
typedef anhyst_memory memory_type;
typedef anhyst_full_memory full_memory;
typedef anhyst_simplified_memory simplified_memory;
typedef anhyst_cells_memory cells_memory;
typedef anhyst_compensator compensator;
typedef anhyst_kernel kernel_type;

#endif
