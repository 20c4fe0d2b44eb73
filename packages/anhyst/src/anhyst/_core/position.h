// SPDX-License-Identifier: Apache-2.0
// What a simulated loop takes for a controller, whatever its number format.
#pragma once

#include "anhyst_plant/controller.h"

class LoopController {
public:
  LoopController() = default;
  LoopController(const LoopController &) = delete;
  LoopController &operator=(const LoopController &) = delete;
  virtual ~LoopController() = default;

  virtual anhyst_loop_controller handle() = 0;
};
