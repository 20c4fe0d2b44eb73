/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in single precision. Declarations: generic/compensator.h. */
#ifndef ANHYST_COMPENSATOR_F32_H
#define ANHYST_COMPENSATOR_F32_H

#include <stddef.h>
#include <stdint.h>

#include "anhyst/compensator/flags.h"
#include "anhyst/compensator/layout.h"
#include "anhyst/compensator/plays.h"
#include "anhyst/compensator/stage.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/compensator.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
