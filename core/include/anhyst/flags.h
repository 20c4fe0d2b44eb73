/* SPDX-License-Identifier: Apache-2.0 */
/* Why a compensator gave another current than the demand asks for: bits, of its last solve. */
#ifndef ANHYST_FLAGS_H
#define ANHYST_FLAGS_H

#define ANHYST_DEMAND_LIMITED 1U  /* the demand was beyond its limits, or below the residual */
#define ANHYST_CURRENT_LIMITED 2U /* the current was */
#define ANHYST_FLUX_LIMITED 4U    /* the flux was */

#endif
