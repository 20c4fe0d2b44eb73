/* SPDX-License-Identifier: Apache-2.0 */

static void ANHYST_NAME(store)(ANHYST_REAL piece[6], jet from, jet to)
{
  double exact[6];
  quintic(from, to, exact);
  for (int i = 0; i < 6; i++) {
    piece[i] = (ANHYST_REAL)exact[i];
  }
}

/* Tables are built in double precision for both formats: it is done once a parameter set. */
static void ANHYST_NAME(tabulate)(ANHYST_NAME(anhyst_pieces) *pieces, double kappa,
                                  jet (*read)(const walker *))
{
  const double inner_width = 1.0 / ANHYST_BRANCH_PER_UNIT;
  walker w = walker_start(kappa);
  double x = -outer_node(ANHYST_BRANCH_OUTER);
  walker_advance(&w, x);
  jet last = outer_jet(read(&w), x);
  for (int i = ANHYST_BRANCH_OUTER - 1; i >= 0; i--) {
    x = -outer_node(i);
    walker_advance(&w, x);
    const jet next = outer_jet(read(&w), x);
    ANHYST_NAME(store)(pieces->left[i], next, last);
    last = next;
  }
  last = by_place(read(&w), inner_width, 0.0);
  for (int i = 0; i < ANHYST_BRANCH_INNER; i++) {
    walker_advance(&w, -ANHYST_BRANCH_EDGE + (i + 1) * inner_width);
    const jet next = by_place(read(&w), inner_width, 0.0);
    ANHYST_NAME(store)(pieces->inner[i], last, next);
    last = next;
  }
  last = outer_jet(read(&w), outer_node(0));
  for (int i = 0; i < ANHYST_BRANCH_OUTER; i++) {
    x = outer_node(i + 1);
    walker_advance(&w, x);
    const jet next = outer_jet(read(&w), x);
    ANHYST_NAME(store)(pieces->right[i], last, next);
    last = next;
  }
}

static ANHYST_REAL ANHYST_NAME(piece_at)(const ANHYST_REAL c[6], ANHYST_REAL t)
{
  return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
}

static ANHYST_REAL ANHYST_NAME(pieces_at)(const ANHYST_NAME(anhyst_pieces) *pieces, ANHYST_REAL x)
{
  const ANHYST_REAL size = ANHYST_FABS(x);
  if (size < R(30.0)) {
    const ANHYST_REAL place = (x + R(30.0)) * (ANHYST_REAL)ANHYST_BRANCH_PER_UNIT;
    const int i = (int)place;
    if (i < ANHYST_BRANCH_INNER) {
      return ANHYST_NAME(piece_at)(pieces->inner[i], place - (ANHYST_REAL)i);
    }
  }
  ANHYST_REAL place = ANHYST_LOG(size / R(30.0)) * (ANHYST_REAL)ANHYST_BRANCH_PER_LOG;
  if (!(place > R(0.0))) {
    place = R(0.0);
  }
  if (!(place < (ANHYST_REAL)ANHYST_BRANCH_OUTER)) {
    place = (ANHYST_REAL)ANHYST_BRANCH_OUTER;
  }
  int i = (int)place;
  if (i == ANHYST_BRANCH_OUTER) {
    i--;
  }
  return ANHYST_NAME(piece_at)(x < R(0.0) ? pieces->left[i] : pieces->right[i],
                               place - (ANHYST_REAL)i);
}

anhyst_status ANHYST_NAME(anhyst_branch_build)(ANHYST_NAME(anhyst_branch) *branch,
                                               ANHYST_REAL kappa)
{
  if (!kappa_allowed((double)kappa)) {
    return ANHYST_BAD_PARAMETER;
  }
  branch->kappa = kappa;
  ANHYST_NAME(tabulate)(&branch->value, (double)kappa, walker_value);
  return ANHYST_OK;
}

anhyst_status ANHYST_NAME(anhyst_branch_slope_build)(ANHYST_NAME(anhyst_branch_slope) *slope,
                                                     ANHYST_REAL kappa)
{
  if (!kappa_allowed((double)kappa)) {
    return ANHYST_BAD_PARAMETER;
  }
  ANHYST_NAME(tabulate)(&slope->value, (double)kappa, walker_tilted);
  return ANHYST_OK;
}

ANHYST_REAL ANHYST_NAME(anhyst_branch_at)(const ANHYST_NAME(anhyst_branch) *branch, ANHYST_REAL x)
{
  return ANHYST_NAME(pieces_at)(&branch->value, x);
}

ANHYST_REAL ANHYST_NAME(anhyst_branch_slope_at)(const ANHYST_NAME(anhyst_branch_slope) *slope,
                                                ANHYST_REAL x)
{
  return ANHYST_NAME(pieces_at)(&slope->value, x);
}
