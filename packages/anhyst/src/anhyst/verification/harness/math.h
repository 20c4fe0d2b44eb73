/* SPDX-License-Identifier: Apache-2.0 */
/* Functions of <math.h> that the controller of a stage uses, for processors without a library. */
float sqrtf(float x);
float fabsf(float x);

#define isfinite(x) __builtin_isfinite(x)
