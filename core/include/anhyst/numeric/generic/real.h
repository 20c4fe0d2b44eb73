/* SPDX-License-Identifier: Apache-2.0 */

static inline ANHYST_REAL anhyst_add_x(ANHYST_REAL a, ANHYST_REAL b) { return a + b; }
static inline ANHYST_REAL anhyst_sub_x(ANHYST_REAL a, ANHYST_REAL b) { return a - b; }
