/* SPDX-License-Identifier: Apache-2.0 */
/* The map with one play for 10^7 ticks at rest, about 8 minutes at 20 kHz. */
#include "rest.h"

int main(void)
{
  current_does_not_drift_at_rest(10000000);
  return verdict();
}
