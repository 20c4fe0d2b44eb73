// SPDX-License-Identifier: Apache-2.0
// Interface of all controllers that a simulated loop can run.
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
