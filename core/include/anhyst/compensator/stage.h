/* SPDX-License-Identifier: Apache-2.0 */
/* What a compensator knows beside its memory: the stages of its candidate, in every format.

     stage     the candidate `next` is                    start, swap, other memory -> UNKNOWN
     UNKNOWN   nothing                                    solve                     -> AHEAD
     AHEAD     where the step of the last solve leads     commit                    -> HERE
     HERE      where the memory stands

   A search that sets out from the memory may begin at the candidate in two cases. `field` may where
   the stage is HERE, since the demand has moved little since the last tick. `flux` may where it is
   HERE or AHEAD, since the applied current is near the solved one. In all other cases it begins at
   the memory itself. A second solve without a commit finds AHEAD, and begins at the memory. */
#ifndef ANHYST_STAGE_H
#define ANHYST_STAGE_H

enum { ANHYST_STAGE_UNKNOWN = 0, ANHYST_STAGE_AHEAD = 1, ANHYST_STAGE_HERE = 2 };

/* In the flags of a compensator while it computes: a function inside another one is an error. */
#define ANHYST_FLAG_BUSY 0x8000U

#endif
