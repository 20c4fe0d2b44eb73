// SPDX-License-Identifier: Apache-2.0
// The C types and functions of a compensator in each number format.
#pragma once

#include <stdexcept>
#include <string>

#include "anhyst/compensator/compensator.h"
#include "anhyst/compensator/compensator_real.h"
#include "arrays.h"

// ENTRY: type of a word of a block; NUMBER: type of a state variable; SIZE: type of word counts.
#define FORMAT(F, ENTRY, NUMBER, SIZE, f)                                                          \
  struct F {                                                                                       \
    using Entry = ENTRY;                                                                           \
    using Number = NUMBER;                                                                         \
    using Size = SIZE;                                                                             \
    using Memory = anhyst_memory##f;                                                               \
    using Kernel = anhyst_kernel##f;                                                               \
    using Compensator = anhyst_compensator##f;                                                     \
    static constexpr auto full = &anhyst_kernel_full##f;                                           \
    static constexpr auto simplified = &anhyst_kernel_simplified##f;                               \
    static constexpr auto cells = &anhyst_kernel_cells##f;                                         \
    static constexpr auto init = anhyst_compensator_init_sized##f;                                 \
    static constexpr auto check = anhyst_block_check##f;                                           \
    static constexpr auto swap = anhyst_compensator_swap##f;                                       \
    static constexpr auto conditioning_length = anhyst_conditioning_length##f;                     \
  }
FORMAT(Fixed, int16_t, int32_t, uint16_t, );
FORMAT(F32, float, float, uint32_t, _f32);
FORMAT(F64, double, double, uint32_t, _f64);
#undef FORMAT

// Python array with the words of a parameter block.
template <class F>
using Words = nb::ndarray<const typename F::Entry, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Returns the kernel of a kind of compensator.
template <class F> const typename F::Kernel *to_kernel(const std::string &kind)
{
  if (kind == "full") {
    return F::full;
  }
  if (kind == "simplified") {
    return F::simplified;
  }
  if (kind == "cells") {
    return F::cells;
  }
  if constexpr (std::is_same_v<F, Fixed>) {
    if (kind == "euler") {
      return &anhyst_kernel_euler;
    }
  }
  throw std::invalid_argument("unknown kind of compensator: " + kind);
}
