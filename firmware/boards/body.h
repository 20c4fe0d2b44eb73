/* SPDX-License-Identifier: Apache-2.0 */
/* The body that a firmware is built with, see app/body.h: named by -DACTUATOR_BODY=force or
   position. */
#ifndef ANHYST_ACTUATOR_BODY_H
#define ANHYST_ACTUATOR_BODY_H

#include "boards/actuator.h"

#include ACTUATOR_FILE(ACTUATOR_BODY/ACTUATOR_BODY.h)

#endif
