/* SPDX-License-Identifier: Apache-2.0 */
/* The meaning of the trial step c->next of a compensator, in every number format.

     ANHYST_STAGE_UNKNOWN  c->next is not valid, after init, demagnetise, swap and restore.
     ANHYST_STAGE_AHEAD    c->next is the step of the last solve.
     ANHYST_STAGE_HERE     c->next is the present state, after a commit.

   In two cases, a search may start at c->next instead of the present state. The search for a field
   may do so in ANHYST_STAGE_HERE, because the demand has changed little since the last tick. The
   search for a flux may do so in ANHYST_STAGE_HERE and ANHYST_STAGE_AHEAD, because the applied
   current is close to the solved one. A second solve without a commit starts at the present
   state. */
#ifndef ANHYST_STAGE_H
#define ANHYST_STAGE_H

enum { ANHYST_STAGE_UNKNOWN = 0, ANHYST_STAGE_AHEAD = 1, ANHYST_STAGE_HERE = 2 };

/* With ANHYST_ASSERT (port.h), set in the flags of a compensator during a call: detects nested
   calls. */
#define ANHYST_FLAG_BUSY 0x8000U

#endif
