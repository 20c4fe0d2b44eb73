/* SPDX-License-Identifier: Apache-2.0 */
/* The meaning of the trial step `next` of a compensator, in every format.

     stage     `next` is                              set by
     UNKNOWN   not valid                              start, swap, another memory
     AHEAD     the step of the last solve             solve
     HERE      the present state                      commit

   A search that starts from the memory may start at `next` in two cases. `field` may do so if the
   stage is HERE, because the demand has changed little since the last tick. `flux` may do so if the
   stage is HERE or AHEAD, because the applied current is close to the solved one. In all other
   cases, the search starts at the memory itself. A second solve without a commit starts at the
   memory. */
#ifndef ANHYST_STAGE_H
#define ANHYST_STAGE_H

enum { ANHYST_STAGE_UNKNOWN = 0, ANHYST_STAGE_AHEAD = 1, ANHYST_STAGE_HERE = 2 };

/* Set in the flags of a compensator during a call. A nested call is an error. */
#define ANHYST_FLAG_BUSY 0x8000U

#endif
