/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status anhyst_biquad_check_x(const anhyst_biquad_x *filter)
{
  const int finite = isfinite(filter->forward[0]) && isfinite(filter->forward[1]) &&
                     isfinite(filter->forward[2]) && isfinite(filter->back[0]) &&
                     isfinite(filter->back[1]);
  return finite ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

ANHYST_REAL anhyst_biquad_step_x(const anhyst_biquad_x *filter, anhyst_biquad_state_x *state,
                                 ANHYST_REAL in)
{
  const ANHYST_REAL out = filter->forward[0] * in + state->delayed[0];
  state->delayed[0] = filter->forward[1] * in - filter->back[0] * out + state->delayed[1];
  state->delayed[1] = filter->forward[2] * in - filter->back[1] * out;
  return out;
}
