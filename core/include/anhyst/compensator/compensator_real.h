/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in single and double precision. */
#ifndef ANHYST_COMPENSATOR_REAL_H
#define ANHYST_COMPENSATOR_REAL_H

#include "anhyst/compensator/compensator_f32.h"
#include "anhyst/compensator/compensator_f64.h"

#endif
