// SPDX-License-Identifier: Apache-2.0
// The reason why a controller refuses a command, from the C function of a real controller.
#include "anhyst/control/supervisor.h"
#include "arrays.h"

namespace {

const char *obstacle(uint16_t command, uint16_t state, bool conditioning, bool plausible,
                     bool levitates, bool resting, bool at_zero)
{
  anhyst_supervisor supervisor{};
  supervisor.state = state;
  supervisor.conditioning = conditioning ? 1U : 0U;
  supervisor.sample_age = plausible ? 0U : 1U;
  const anhyst_body body = {static_cast<uint16_t>(levitates), static_cast<uint16_t>(resting),
                            static_cast<uint16_t>(at_zero)};
  switch (anhyst_supervisor_obstacle(&supervisor, command, &body)) {
  case ANHYST_REFUSED_NOT:
    return "";
  case ANHYST_REFUSED_STATE:
    return "state";
  case ANHYST_REFUSED_CURRENT:
    return "current";
  default:
    return "unknown";
  }
}

} // namespace

void bind_supervisor(nb::module_ &m)
{
  m.def("obstacle", &obstacle, "command"_a, "state"_a, "conditioning"_a, "plausible"_a,
        "levitates"_a, "resting"_a, "at_zero"_a);
}
