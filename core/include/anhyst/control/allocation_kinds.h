/* SPDX-License-Identifier: Apache-2.0 */
/* Kinds of force allocation, for every number format; see allocation.h. */
#ifndef ANHYST_ALLOCATION_KINDS_H
#define ANHYST_ALLOCATION_KINDS_H

#define ANHYST_ALLOCATE_SINGLE 1U
#define ANHYST_ALLOCATE_BY_HALVES 2U
#define ANHYST_ALLOCATE_CLASS_AB 3U

#endif
