/* SPDX-License-Identifier: Apache-2.0 */
/* How a force controller finds its current, in every number format; see force_controller.h. */
#ifndef ANHYST_FORCE_METHOD_H
#define ANHYST_FORCE_METHOD_H

#define ANHYST_FORCE_BY_MAP 1U
#define ANHYST_FORCE_BY_COMPENSATOR 2U
#define ANHYST_FORCE_BY_FLUX 3U
#define ANHYST_FORCE_PAST_COMPENSATOR 4U /* by a map, while a compensator follows */
#define ANHYST_FORCE_BY_PLAY 5U

#endif
