/* SPDX-License-Identifier: Apache-2.0 */

/* Arrangement of the drives; constant. */
typedef struct {
  uint16_t axes;            /* number of components of a wrench, 1..6 */
  uint16_t drives;          /* number of drives, 1..16 */
  const ANHYST_REAL *pull;  /* wrench for a force of 1 N, one row for each drive */
  const uint16_t *against;  /* for each drive, the index of the drive that pulls against it; its own
                               index for a single drive */
  anhyst_allocation_x pair; /* allocation in pairs; kind `single` without pairs */
  ANHYST_REAL least;        /* minimum force of a single drive, N; negative if it also pushes */
  /* After the loss of a drive: largest force of each other drive, N, and a weight of each axis.
     Axes with a large weight are given up first. */
  ANHYST_REAL most;
  const ANHYST_REAL *yields; /* weight of each axis, > 0 and at most 1 */
} anhyst_wrench_layout_x;

/* Normal matrix of the free drives, factorised as U'DU. U has ones on its diagonal. */
typedef struct {
  uint16_t free_drives;                /* bit mask of the drives; of a pair, only the first */
  ANHYST_REAL row[ANHYST_WRENCH_AXES]; /* diagonal of the normal matrix */
  ANHYST_REAL upper[ANHYST_WRENCH_AXES][ANHYST_WRENCH_AXES]; /* U; on the diagonal, 1/D */
} anhyst_wrench_factor_x;

/* Start values of every search, and factorisations of the last search. A tick usually gives up the
   same axes as the last one. */
typedef struct {
  const anhyst_wrench_layout_x *layout;
  uint16_t against[ANHYST_WRENCH_DRIVES]; /* partner of each drive, without lost drives */
  uint16_t lost;                          /* bit mask of the lost drives */
  uint16_t free_drives;   /* drives with unknown force, bit mask; of a pair, only the first */
  uint16_t single_drives; /* bit mask of the single drives that are not lost */
  int makes_every_wrench; /* whether the remaining drives can make every wrench if they also push */
  ANHYST_REAL scale[ANHYST_WRENCH_AXES];                      /* scale factor of each axis */
  ANHYST_REAL pull[ANHYST_WRENCH_DRIVES][ANHYST_WRENCH_AXES]; /* scaled `pull` of the layout */
  anhyst_wrench_factor_x factor; /* factorised matrix of the free drives */
  anhyst_wrench_factor_x yield_factor[ANHYST_WRENCH_PASSES + 1]; /* matrix of a pass with yields */
} anhyst_wrench_x;

/* Returns ANHYST_OK if the numbers, the pairs and the idle force are valid, and the drives can make
   every wrench (if single drives could also push). Otherwise returns ANHYST_BAD_PARAMETER. The
   layout must live as long as w. */
anhyst_status anhyst_wrench_init_x(anhyst_wrench_x *w, const anhyst_wrench_layout_x *layout);

/* Excludes a lost drive from all later allocations. */
void anhyst_wrench_lose_x(anhyst_wrench_x *w, int drive);

/* Sets the forces of the drives for a wrench, N. Returns 1 if the drives make the wrench, otherwise
   0. Each single drive has at least its minimum force, a lost drive none. NaN counts as 0. */
int anhyst_wrench_share_x(anhyst_wrench_x *w, const ANHYST_REAL *wrench, ANHYST_REAL *force);
