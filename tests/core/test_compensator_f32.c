/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the compensator in single precision. */
#include <math.h>

#include "compensator/formats/f32.h"

#define FORMAT(name) name##_f32
#define signal float
#define FULL_DEMAND ((float)300)
#define FULL_CURRENT ((float)4)
#define CURRENT_LIMIT (FULL_CURRENT / 8)
#define GAP ((float)4e-4)
#define GAP_LOW ((float)3e-4)
#define GAP_HIGH ((float)6e-4)
#define GAP_BELOW ((float)2.9e-4)
#define SOLVE anhyst_compensator_solve_f32
#define COMMIT anhyst_compensator_commit_f32
#define SIGNALS(name) name##_f32
#define OUTPUT anhyst_compensator_output_f32
#define CONDITIONING(c, tick) anhyst_conditioning_f32(c, tick)

#include "check.h"
#include "real_claims.h"

#include "compensator_claims.h"
