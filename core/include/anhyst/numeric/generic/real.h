/* SPDX-License-Identifier: Apache-2.0 */

static inline ANHYST_REAL ANHYST_NAME(anhyst_add)(ANHYST_REAL a, ANHYST_REAL b) { return a + b; }

static inline ANHYST_REAL ANHYST_NAME(anhyst_sub)(ANHYST_REAL a, ANHYST_REAL b) { return a - b; }
