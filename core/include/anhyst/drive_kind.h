/* SPDX-License-Identifier: Apache-2.0 */
/* What a drive makes its current with, in every number format; see drive.h. */
#ifndef ANHYST_DRIVE_KIND_H
#define ANHYST_DRIVE_KIND_H

#define ANHYST_DRIVE_MAP 1U
#define ANHYST_DRIVE_COMPENSATOR 2U
#define ANHYST_DRIVE_FLUX 3U

#endif
