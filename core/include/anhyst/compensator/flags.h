/* SPDX-License-Identifier: Apache-2.0 */
/* Flags of a solve and of a tick, the same in every number format. Made by tools/contract from
   contract/controller.toml. */
/* clang-format off */
#ifndef ANHYST_FLAGS_H
#define ANHYST_FLAGS_H

/* Limits and events of a tick. */
/* the parameter block or the residual force limited the demand of the last tick */
#define ANHYST_DEMAND_LIMITED 1U
#define ANHYST_CURRENT_LIMITED 2U /* the parameter block or the board limited the current */
#define ANHYST_FLUX_LIMITED 4U /* the parameter block limited the flux */
#define ANHYST_SAMPLE_IMPLAUSIBLE 8U /* the last plausible sample replaced an implausible one */
#define ANHYST_COMMAND_REFUSED 16U /* the command of this tick is not allowed in this state */
#define ANHYST_DEMAND_SLEWING 32U /* the slew limit delays the demand */
#define ANHYST_CONDITIONING 64U /* the conditioning sequence runs */
#define ANHYST_KNOWN 128U /* the hysteresis state is assumed to be known */
#define ANHYST_CURRENT_ZERO 256U /* the commanded current is zero */
#define ANHYST_GAP_LIMITED 512U /* the gap is outside the range of the parameter block */
#define ANHYST_UNCOMMITTED 1024U /* two solves without a commit between them */

#endif
