/* SPDX-License-Identifier: Apache-2.0 */
/* In place of the one header that anhyst compile writes: the core's own, with the same contents. */
#ifndef ANHYST_H
#define ANHYST_H

#include "anhyst/compensator.h"
#include "anhyst/supervisor.h"

#endif
