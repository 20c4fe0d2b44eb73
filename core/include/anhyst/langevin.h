/* SPDX-License-Identifier: Apache-2.0 */
/* The Langevin function, its slope and its inverse. Declarations are in generic/langevin.h. */
#ifndef ANHYST_LANGEVIN_H
#define ANHYST_LANGEVIN_H

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/langevin.h"
#include "anhyst/f32.h"
#include "anhyst/generic/langevin.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
