/* SPDX-License-Identifier: Apache-2.0 */

/* How the drives stand; constant. */
typedef struct {
  uint16_t axes;           /* numbers of a wrench, 1..6 */
  uint16_t drives;         /* 1..16 */
  const ANHYST_REAL *pull; /* a row a drive: the wrench of 1 N of it */
  const uint16_t
      *against; /* for each drive that which pulls against it, itself where it is alone */
  anhyst_allocation_x pair; /* how pairs share; single where there are none */
  ANHYST_REAL least;        /* of a drive that stands alone, N; below 0 where it goes both ways */
  /* Once a drive is lost: the most of the others, N, and of each axis how readily it is given up.
   */
  ANHYST_REAL most;
  const ANHYST_REAL *yields; /* > 0, of 1 */
} anhyst_wrench_layout_x;

/* What drives make along one axis for what they make along another, as U'DU, U with ones on its
   diagonal. */
typedef struct {
  uint16_t free;                       /* the drives, bit by bit; of a pair the first */
  ANHYST_REAL row[ANHYST_WRENCH_AXES]; /* the diagonal of the product */
  ANHYST_REAL upper[ANHYST_WRENCH_AXES][ANHYST_WRENCH_AXES]; /* U, and 1 over D on its diagonal */
} anhyst_wrench_factor_x;

/* What every search begins with, and what the last one found on its way: a tick mostly gives up
   what the one before did. */
typedef struct {
  const anhyst_wrench_layout_x *layout;
  uint16_t against[ANHYST_WRENCH_DRIVES]; /* as in the layout, without what is lost */
  uint16_t lost;                          /* drives, bit by bit */
  uint16_t open;  /* those whose force is to be found; of a pair the first */
  uint16_t alone; /* those that stand alone, but what is lost */
  int whole; /* whether the others can still push along every axis, if those alone could push too */
  ANHYST_REAL scale[ANHYST_WRENCH_AXES]; /* of each axis, so that all weigh alike */
  ANHYST_REAL pull[ANHYST_WRENCH_DRIVES][ANHYST_WRENCH_AXES]; /* scaled */
  anhyst_wrench_factor_x factor;                              /* of all of them */
  anhyst_wrench_factor_x given_up[ANHYST_WRENCH_PASSES + 1];  /* with yields, by pass */
} anhyst_wrench_x;

/* ANHYST_OK where numbers, pairs and idle force are valid and the drives can push along every axis,
   if those alone could push too. The layout must live as long as what is made of it. */
anhyst_status anhyst_wrench_init_x(anhyst_wrench_x *w, const anhyst_wrench_layout_x *layout);

/* Does without a drive from now on. */
void anhyst_wrench_lose_x(anhyst_wrench_x *w, int drive);

/* Forces of the drives, N, for a wrench. 1 where they make it; else 0, and each drive alone still
   pulls its least; what is no number counts as no force. Lost drives pull nothing. */
int anhyst_wrench_share_x(anhyst_wrench_x *w, const ANHYST_REAL *wrench, ANHYST_REAL *force);
