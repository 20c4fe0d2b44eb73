/* SPDX-License-Identifier: Apache-2.0 */
/* The map with one play for 10^7 ticks at rest, about 8 minutes at 20 kHz. */
#include "rest.h"

int main(void)
{
  it_does_not_creep_at_rest(10000000);
  return verdict();
}
