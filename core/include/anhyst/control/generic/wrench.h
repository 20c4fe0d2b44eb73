/* SPDX-License-Identifier: Apache-2.0 */

/* How the drives stand; constant. */
typedef struct {
  uint16_t axes;           /* numbers of a wrench, 1..6 */
  uint16_t drives;         /* 1..16 */
  const ANHYST_REAL *pull; /* a row a drive: the wrench of 1 N of it */
  const uint16_t
      *against; /* for each drive that which pulls against it, itself where it is alone */
  ANHYST_NAME(anhyst_allocation) pair; /* how pairs share; single where there are none */
  ANHYST_REAL least; /* of a drive that stands alone, N; below 0 where it goes both ways */
  /* Once a drive is lost: the most of the others, N, and of each axis how readily it is given up.
   */
  ANHYST_REAL most;
  const ANHYST_REAL *yields; /* > 0, of 1 */
} ANHYST_NAME(anhyst_wrench_layout);

typedef struct {
  ANHYST_REAL lower[ANHYST_WRENCH_AXES][ANHYST_WRENCH_AXES];
} ANHYST_NAME(anhyst_wrench_factor);

/* What every search begins with. */
typedef struct {
  const ANHYST_NAME(anhyst_wrench_layout) *layout;
  uint16_t against[ANHYST_WRENCH_DRIVES]; /* as in the layout, without what is lost */
  uint16_t lost;                          /* drives, bit by bit */
  int whole; /* whether the others can still push along every axis, if those alone could push too */
  ANHYST_REAL scale[ANHYST_WRENCH_AXES]; /* of each axis, so that all weigh alike */
  ANHYST_REAL pull[ANHYST_WRENCH_DRIVES][ANHYST_WRENCH_AXES]; /* scaled */
  ANHYST_NAME(anhyst_wrench_factor) factor;                   /* with all drives free */
} ANHYST_NAME(anhyst_wrench);

/* ANHYST_OK where numbers, pairs and idle force are valid and the drives can push along every axis,
   if those alone could push too. The layout must live as long as what is made of it. */
anhyst_status ANHYST_NAME(anhyst_wrench_init)(ANHYST_NAME(anhyst_wrench) *w,
                                              const ANHYST_NAME(anhyst_wrench_layout) *layout);

/* Does without a drive from now on. */
void ANHYST_NAME(anhyst_wrench_lose)(ANHYST_NAME(anhyst_wrench) *w, int drive);

/* Forces of the drives, N, for a wrench. 1 where they make it; else 0, and each drive alone still
   pulls its least; what is no number counts as no force. Lost drives pull nothing. */
int ANHYST_NAME(anhyst_wrench_share)(const ANHYST_NAME(anhyst_wrench) *w, const ANHYST_REAL *wrench,
                                     ANHYST_REAL *force);
