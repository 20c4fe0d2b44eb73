// SPDX-License-Identifier: Apache-2.0
// Gains of the position controller in each number format, and the C functions that use them.
#pragma once

#include <array>

#include "anhyst/control/pidd2.h"
#include "anhyst/control/pidd2_real.h"
#include "arrays.h"

using GainWords = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

[[noreturn]] inline void refuse_gains()
{
  throw std::invalid_argument("a gain is out of its range");
}

struct GainsQ31 {
  using number = int32_t;
  using row = GainWords;
  using gains = anhyst_pidd2_gains_q31;
  using state = anhyst_pidd2_state_q31;
  using candidate = anhyst_pidd2_candidate_q31;
  static constexpr auto check = anhyst_pidd2_check_q31;
  static constexpr auto start = anhyst_pidd2_start_q31;
  static constexpr auto solve = anhyst_pidd2_solve_q31;
  static constexpr auto commit = anhyst_pidd2_commit_q31;
  static constexpr auto change = anhyst_pidd2_change_q31;

  static int16_t to_int16(int32_t word)
  {
    if (word < INT16_MIN || word > INT16_MAX) {
      refuse_gains();
    }
    return static_cast<int16_t>(word);
  }

  static gains read_values(const row &words)
  {
    same_length(19, words.shape(0), "gains");
    std::array<anhyst_factor, 8> f;
    for (size_t i = 0; i < f.size(); i++) {
      f[i] = {to_int16(words(2 * i)), to_int16(words(2 * i + 1))};
    }
    return {f[0], f[1],      f[2],     f[3], f[4], f[5], f[6], f[7], to_int16(words(16)),
            0,    words(17), words(18)};
  }
};

template <class Number, class Gains, class State, class Candidate> struct RealGains {
  using number = Number;
  using row = In;
  using gains = Gains;
  using state = State;
  using candidate = Candidate;

  static gains read_values(const row &values)
  {
    same_length(11, values.shape(0), "gains");
    std::array<Number, 11> v;
    for (size_t i = 0; i < v.size(); i++) {
      v[i] = static_cast<Number>(values(i));
    }
    return {v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10]};
  }
};

#define GAINS(F, REAL, f)                                                                          \
  struct Gains##F : RealGains<REAL, anhyst_pidd2_gains_##f, anhyst_pidd2_state_##f,                \
                              anhyst_pidd2_candidate_##f> {                                        \
    static constexpr auto check = anhyst_pidd2_check_##f;                                          \
    static constexpr auto start = anhyst_pidd2_start_##f;                                          \
    static constexpr auto solve = anhyst_pidd2_solve_##f;                                          \
    static constexpr auto commit = anhyst_pidd2_commit_##f;                                        \
    static constexpr auto change = anhyst_pidd2_change_##f;                                        \
  }
GAINS(F64, double, f64);
GAINS(F32, float, f32);
#undef GAINS

// Reads gains, and throws an error if the core rejects them.
template <class Format> typename Format::gains valid_gains(const typename Format::row &row)
{
  const typename Format::gains gains = Format::read_values(row);
  if (Format::check(&gains) != ANHYST_OK) {
    refuse_gains();
  }
  return gains;
}
