// SPDX-License-Identifier: Apache-2.0
// Parameters of a floating-point compensator, with the tables they point to.
#pragma once

#include <string>
#include <vector>

#include "anhyst/compensator/compensator_real.h"
#include "arrays.h"

// The C types and functions of one number format.
#define FORMAT(F, REAL, f)                                                                         \
  struct F {                                                                                       \
    using Real = REAL;                                                                             \
    using AtGap = anhyst_at_gap_##f;                                                               \
    using Full = anhyst_full_law_##f;                                                              \
    using Simplified = anhyst_simplified_law_##f;                                                  \
    using Cells = anhyst_cells_law_##f;                                                            \
    using Solid = anhyst_solid_##f;                                                                \
    using Parameters = anhyst_parameters_##f;                                                      \
    using Memory = anhyst_memory_##f;                                                              \
    using Compensator = anhyst_compensator_##f;                                                    \
    static constexpr auto kernel_full = &anhyst_kernel_full_##f;                                   \
    static constexpr auto kernel_simplified = &anhyst_kernel_simplified_##f;                       \
    static constexpr auto kernel_cells = &anhyst_kernel_cells_##f;                                 \
    static constexpr auto cells_stand = anhyst_cells_stand_##f;                                    \
    static constexpr auto check = anhyst_parameters_check_##f;                                     \
    static constexpr auto init = anhyst_compensator_init_##f;                                      \
    static constexpr auto swap = anhyst_compensator_swap_##f;                                      \
    static constexpr auto solve = anhyst_compensator_solve_##f;                                    \
    static constexpr auto commit = anhyst_compensator_commit_##f;                                  \
    static constexpr auto output = anhyst_compensator_output_##f;                                  \
    static constexpr auto conditioning_length = anhyst_conditioning_length_##f;                    \
    static constexpr auto conditioning = anhyst_conditioning_##f;                                  \
  }
FORMAT(F64, double, f64);
FORMAT(F32, float, f32);
#undef FORMAT

using InRows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Parameters with the tables they point to.
template <class F> class Owned {
public:
  using Real = typename F::Real;

  Owned(const std::string &kind, const nb::dict &numbers, const InRows &gaps,
        const nb::dict &tables)
  {
    if (gaps.shape(0) < 2 || gaps.shape(1) != 5) {
      throw std::invalid_argument(
          "a row of the gap table has five numbers, and there are two rows");
    }
    for (size_t i = 0; i < gaps.shape(0); i++) {
      gaps_.push_back({real(gaps(i, 0)), real(gaps(i, 1)), real(gaps(i, 2)), real(gaps(i, 3)),
                       real(gaps(i, 4))});
    }
    common(numbers);
    if (kind == "full") {
      full(numbers, tables);
    } else if (kind == "simplified") {
      simplified(numbers, tables);
    } else if (kind == "cells") {
      cells(numbers, tables);
    } else {
      throw std::invalid_argument("unknown kind of compensator: " + kind);
    }
    if (F::check(&parameters_) != ANHYST_OK) {
      throw std::invalid_argument("the parameters are not valid");
    }
  }
  Owned(const Owned &) = delete;
  Owned &operator=(const Owned &) = delete;

  const typename F::Parameters *get() const { return &parameters_; }

private:
  static Real real(double value) { return static_cast<Real>(value); }
  static Real real(const nb::dict &from, const char *name)
  {
    return real(nb::cast<double>(from[name]));
  }
  static uint16_t count(const nb::dict &from, const char *name)
  {
    return nb::cast<uint16_t>(from[name]);
  }

  // A table of so many entries.
  const Real *table(const nb::dict &from, const char *name, size_t entries)
  {
    const In values = nb::cast<In>(from[name]);
    same_length(entries, values.shape(0), name);
    std::vector<Real> copy(entries);
    for (size_t i = 0; i < entries; i++) {
      copy[i] = real(values(i));
    }
    tables_.push_back(std::move(copy));
    return tables_.back().data();
  }

  void common(const nb::dict &from)
  {
    parameters_.demand_low = real(from, "demand_low");
    parameters_.demand_high = real(from, "demand_high");
    parameters_.current_low = real(from, "current_low");
    parameters_.current_high = real(from, "current_high");
    parameters_.full_scale = real(from, "full_scale");
    parameters_.knee = real(from, "knee");
    parameters_.flux_limit = real(from, "flux_limit");
    parameters_.gap_low = real(from, "gap_low");
    parameters_.gap_rows = real(from, "gap_rows");
    parameters_.gaps = gaps_.data();
    parameters_.gap_segments = static_cast<uint16_t>(gaps_.size() - 1);
    parameters_.power = count(from, "power");
    parameters_.condition_cycles = count(from, "condition_cycles");
    parameters_.condition_ticks = count(from, "condition_ticks");
  }

  void full(const nb::dict &from, const nb::dict &tables)
  {
    full_.air = real(from, "air");
    full_.reversible = real(from, "reversible");
    full_.play = real(from, "play");
    full_.octaves = real(from, "octaves");
    full_.reach = real(from, "reach");
    full_.iterations = count(from, "iterations");
    full_.curve_segments = count(from, "curve_segments");
    full_.inverse_segments = count(from, "inverse_segments");
    full_.curve = table(tables, "curve", full_.curve_segments + 1U);
    full_.branch = table(tables, "branch", 2U * full_.curve_segments + 1U);
    full_.inverse = table(tables, "inverse", full_.inverse_segments + 1U);
    parameters_.kernel = F::kernel_full;
    parameters_.full = &full_;
  }

  void simplified(const nb::dict &from, const nb::dict &tables)
  {
    simplified_.rate = real(from, "rate");
    simplified_.hold = real(from, "hold");
    simplified_.nu = real(from, "nu");
    simplified_.first = real(from, "first");
    simplified_.iterations = count(from, "iterations");
    simplified_.octaves = count(from, "octaves");
    simplified_.segments = count(from, "segments");
    simplified_.curve =
        table(tables, "curve", (simplified_.octaves + 1U) * simplified_.segments + 1U);
    parameters_.kernel = F::kernel_simplified;
    parameters_.simplified = &simplified_;
  }

  void cells(const nb::dict &from, const nb::dict &tables)
  {
    cells_.air = real(from, "air");
    cells_.reach = real(from, "reach");
    cells_.cells = count(from, "cells");
    cells_.inner = real(from, "inner");
    cells_.narrow = count(from, "narrow");
    cells_.wide = count(from, "wide");
    cells_.thresholds = table(tables, "thresholds", cells_.cells);
    cells_.rows =
        table(tables, "rows", (cells_.cells + 1U) * (2U * (cells_.narrow + cells_.wide) + 1U));
    parameters_.kernel = F::kernel_cells;
    parameters_.cells = &cells_;
    if (from.contains("layers")) {
      solid(from);
    }
  }

  void solid(const nb::dict &from)
  {
    solid_.stand = F::cells_stand;
    solid_.hold = real(from, "hold");
    solid_.own = real(from, "own");
    solid_.surface = real(from, "surface");
    solid_.laminated = real(from, "laminated");
    solid_.layers = count(from, "layers");
    parameters_.solid = &solid_;
  }

  typename F::Parameters parameters_{};
  typename F::Full full_{};
  typename F::Simplified simplified_{};
  typename F::Cells cells_{};
  typename F::Solid solid_{};
  std::vector<typename F::AtGap> gaps_;
  std::vector<std::vector<Real>> tables_;
};
