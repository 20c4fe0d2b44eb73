/* SPDX-License-Identifier: Apache-2.0 */

/* Arrangement of the drives; constant. */
typedef struct {
  uint16_t axes;            /* components of a wrench, 1..6 */
  uint16_t drives;          /* 1..16 */
  const ANHYST_REAL *pull;  /* one row per drive: wrench for a force of 1 N */
  const uint16_t *against;  /* for each drive, the index of the drive that pulls against it; its own
                               index for a single drive */
  anhyst_allocation_x pair; /* allocation in pairs; `single` without pairs */
  ANHYST_REAL least;        /* minimum force of a single drive, N; negative if it also pushes */
  /* After the loss of a drive: maximum force of each other drive, N, and weights to give up
     axes. */
  ANHYST_REAL most;
  const ANHYST_REAL *yields; /* > 0, at most 1 */
} anhyst_wrench_layout_x;

/* Normal matrix of the free drives, factorised as U'DU; U has ones on its diagonal. */
typedef struct {
  uint16_t free;                       /* drives in the matrix, bit mask; of a pair the first */
  ANHYST_REAL row[ANHYST_WRENCH_AXES]; /* diagonal of the normal matrix */
  ANHYST_REAL upper[ANHYST_WRENCH_AXES][ANHYST_WRENCH_AXES]; /* U, and 1/D on its diagonal */
} anhyst_wrench_factor_x;

/* State that every search starts with, and factorisations of the last search: a tick usually gives
   up the same axes as the last one. */
typedef struct {
  const anhyst_wrench_layout_x *layout;
  uint16_t against[ANHYST_WRENCH_DRIVES]; /* as in the layout, without lost drives */
  uint16_t lost;                          /* lost drives, bit mask */
  uint16_t open;  /* drives whose force is searched for, bit mask; of a pair the first */
  uint16_t alone; /* single drives that are not lost, bit mask */
  int whole;      /* whether the remaining drives make every wrench, if single ones may push */
  ANHYST_REAL scale[ANHYST_WRENCH_AXES];                      /* of each axis, for equal weights */
  ANHYST_REAL pull[ANHYST_WRENCH_DRIVES][ANHYST_WRENCH_AXES]; /* scaled */
  anhyst_wrench_factor_x factor;                              /* of all open drives */
  anhyst_wrench_factor_x given_up[ANHYST_WRENCH_PASSES + 1];  /* with yields, for each pass */
} anhyst_wrench_x;

/* Returns ANHYST_OK if numbers, pairs and idle force are valid, and the drives can make every
   wrench (if single drives could also push), otherwise ANHYST_BAD_PARAMETER. The layout must live
   as long as w. */
anhyst_status anhyst_wrench_init_x(anhyst_wrench_x *w, const anhyst_wrench_layout_x *layout);

/* Excludes a drive from now on. */
void anhyst_wrench_lose_x(anhyst_wrench_x *w, int drive);

/* Sets the forces of the drives for a wrench, N. Returns 1 if they make it. Otherwise returns 0;
   each single drive has at least its minimum; NaN counts as no force. Lost drives have none. */
int anhyst_wrench_share_x(anhyst_wrench_x *w, const ANHYST_REAL *wrench, ANHYST_REAL *force);
