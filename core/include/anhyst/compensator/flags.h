/* SPDX-License-Identifier: Apache-2.0 */
/* Flags of a solve and of a tick, the same in every number format. Made by tools/contract from
   contract/controller.toml. */
/* clang-format off */
#ifndef ANHYST_FLAGS_H
#define ANHYST_FLAGS_H

/* What was in the way at a tick, and more. */
/* by the parameter block or the residual force, as of the last tick */
#define ANHYST_DEMAND_LIMITED 1U
#define ANHYST_CURRENT_LIMITED 2U /* by the parameter block or the board */
#define ANHYST_FLUX_LIMITED 4U /* by the parameter block */
/* an implausible sample was replaced by the last plausible one */
#define ANHYST_SAMPLE_IMPLAUSIBLE 8U
#define ANHYST_COMMAND_REFUSED 16U /* the command of this tick cannot be done in this state */
#define ANHYST_DEMAND_SLEWING 32U /* the demand in force is still on its way */
#define ANHYST_CONDITIONING 64U /* the conditioning sequence runs */
#define ANHYST_KNOWN 128U /* the memory of the iron is taken as known */
#define ANHYST_CURRENT_ZERO 256U /* the current driven is zero */
#define ANHYST_GAP_LIMITED 512U /* a gap out of the range of the parameter block */

#endif
