/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the compensator in double precision. */
#include <math.h>

#include "compensator/formats/f64.h"

#define FORMAT(name) name##_f64
#define signal double
#define FULL_DEMAND ((double)300)
#define FULL_CURRENT ((double)4)
#define CURRENT_LIMIT (FULL_CURRENT / 8)
#define GAP ((double)4e-4)
#define GAP_LOW ((double)3e-4)
#define GAP_HIGH ((double)6e-4)
#define GAP_BELOW ((double)2.9e-4)
#define SOLVE anhyst_compensator_solve_f64
#define COMMIT anhyst_compensator_commit_f64
#define SIGNALS(name) name##_f64
#define OUTPUT anhyst_compensator_output_f64
#define CONDITIONING(c, tick) anhyst_conditioning_f64(c, tick)

#include "check.h"
#include "real_claims.h"

#include "compensator_claims.h"
