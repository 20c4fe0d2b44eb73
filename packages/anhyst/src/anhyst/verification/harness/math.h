/* SPDX-License-Identifier: Apache-2.0 */
/* What the controller of a stage takes of <math.h>, for processors without a library. */
float sqrtf(float x);
float fabsf(float x);

#define isfinite(x) __builtin_isfinite(x)
