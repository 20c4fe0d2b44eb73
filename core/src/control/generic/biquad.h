/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status ANHYST_NAME(anhyst_biquad_check)(const ANHYST_NAME(anhyst_biquad) *filter)
{
  const int finite = isfinite(filter->forward[0]) && isfinite(filter->forward[1]) &&
                     isfinite(filter->forward[2]) && isfinite(filter->back[0]) &&
                     isfinite(filter->back[1]);
  return finite ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

ANHYST_REAL ANHYST_NAME(anhyst_biquad_step)(const ANHYST_NAME(anhyst_biquad) *filter,
                                            ANHYST_NAME(anhyst_biquad_state) *state, ANHYST_REAL in)
{
  const ANHYST_REAL out = filter->forward[0] * in + state->delayed[0];
  state->delayed[0] = filter->forward[1] * in - filter->back[0] * out + state->delayed[1];
  state->delayed[1] = filter->forward[2] * in - filter->back[1] * out;
  return out;
}
