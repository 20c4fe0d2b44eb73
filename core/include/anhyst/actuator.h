/* SPDX-License-Identifier: Apache-2.0 */
/* Names for the one actuator of a program. The compiler options -DACTUATOR_NAME=magnet and
   -DACTUATOR_MACRO=MAGNET select the actuator that `anhyst compile` named magnet. Every program
   then uses the names below, whatever the actuator is called. */
#ifndef ANHYST_ACTUATOR_NAMES_H
#define ANHYST_ACTUATOR_NAMES_H

#define ACTUATOR_PASTE_TOKENS(name, part) name##part
#define ACTUATOR_JOIN(name, part) ACTUATOR_PASTE_TOKENS(name, part)
#define ACTUATOR_MAKE_STRING(words) #words
#define ACTUATOR_FILE(name) ACTUATOR_MAKE_STRING(name)

#include ACTUATOR_FILE(ACTUATOR_JOIN(ACTUATOR_NAME, _parameters).h)

#define ACTUATOR_CALLED ACTUATOR_FILE(ACTUATOR_NAME)

#define ACTUATOR_PARAMETERS ACTUATOR_JOIN(ACTUATOR_NAME, _parameters)

/* Without --name, `anhyst compile` names the actuator "actuator" and defines these macros. */
#ifndef ACTUATOR_KERNEL
#define ACTUATOR_KERNEL ACTUATOR_JOIN(ACTUATOR_MACRO, _KERNEL)
#define ACTUATOR_PARAMETERS_WORDS ACTUATOR_JOIN(ACTUATOR_MACRO, _PARAMETERS_WORDS)
#define ACTUATOR_SCALES ACTUATOR_JOIN(ACTUATOR_MACRO, _SCALES)
#define ACTUATOR_RATE_HZ ACTUATOR_JOIN(ACTUATOR_MACRO, _RATE_HZ)
#endif

#endif
