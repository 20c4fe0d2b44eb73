// SPDX-License-Identifier: Apache-2.0
// Parts of set-point controllers: drives, filters and number formats.
#pragma once

#include <deque>
#include <vector>

#include "anhyst/compensator/force_coded_real.h"
#include "anhyst/control/axes.h"
#include "anhyst_plant/axes.h"
#include "force_controllers.h"
#include "settings.h"

// Returns the physical values of the codes of fixed-point force controllers.
inline anhyst_code_scales_f64 read_scales(Settings &given)
{
  const anhyst_code_scales_f64 scales = {
      given.take<double>("demand_full"), given.take<double>("current_full"),
      given.take<double>("flux_full"), given.take<double>("gap_low"),
      given.take<double>("gap_high")};
  if (!(scales.demand > 0.0 && scales.current > 0.0 && scales.flux > 0.0 &&
        scales.gap_low < scales.gap_high)) {
    throw std::invalid_argument("a scale of the controller is not valid");
  }
  return scales;
}

// Force controllers as the drives of one controller.
template <class F> class Drives {
public:
  Drives() = default;
  Drives(const Drives &) = delete;
  Drives &operator=(const Drives &) = delete;

  void add_magnets(const nb::list &magnets, const anhyst_code_scales_f64 &scales)
  {
    for (size_t i = 0; i < magnets.size(); i++) {
      for (size_t j = 0; j < i; j++) {
        if (magnets[i].is(magnets[j])) {
          throw std::invalid_argument("each magnet has a force controller of its own");
        }
      }
      magnets_.push_back(nb::borrow(magnets[i]));
      drives_.push_back(drive_of(magnets[i], scales));
    }
  }

  // Applies the calibrated correction of each magnet, in the order of anhyst_correction.
  void apply_correction(const InTable &rows)
  {
    using Real = typename F::Real;
    same_shape(drives_.size(), 4, rows, "rows");
    corrected_.resize(drives_.size());
    behind_.resize(drives_.size());
    for (size_t i = 0; i < drives_.size(); i++) {
      const auto at = [&](size_t j) { return static_cast<Real>(rows(i, j)); };
      const typename F::Correction correction = {at(0), at(1), at(2), at(3)};
      check_controller(F::correct(&behind_[i], &corrected_[i], &correction, drives_[i]));
    }
    for (size_t i = 0; i < drives_.size(); i++) {
      drives_[i] = &behind_[i];
    }
  }

  typename F::Drive *const *data() const { return drives_.data(); }
  uint16_t size() const { return static_cast<uint16_t>(drives_.size()); }

private:
  typename F::Drive *drive_of(nb::handle magnet, const anhyst_code_scales_f64 &scales)
  {
    typename F::Own *own = nullptr;
    if (nb::try_cast<typename F::Own *>(magnet, own) && own) {
      return own->get();
    }
    using Real = typename F::Real;
    FixedForceController *fixed = nullptr;
    if (nb::try_cast<FixedForceController *>(magnet, fixed) && fixed) {
      const typename F::CodeScales codes = {
          static_cast<Real>(scales.demand), static_cast<Real>(scales.current),
          static_cast<Real>(scales.flux), static_cast<Real>(scales.gap_low),
          static_cast<Real>(scales.gap_high)};
      coded_.emplace_back();
      in_si_.emplace_back();
      check_controller(F::code(&in_si_.back(), &coded_.back(), &codes, fixed->get()));
      return &in_si_.back();
    }
    if constexpr (std::is_same_v<typename F::Real, double>) {
      RealForceController<ForceControllerF32> *narrow = nullptr;
      if (nb::try_cast<RealForceController<ForceControllerF32> *>(magnet, narrow) && narrow) {
        in_si_.emplace_back();
        anhyst_axes_drive_init_f32(&in_si_.back(), narrow->get());
        return &in_si_.back();
      }
    }
    throw std::invalid_argument("each magnet has a force controller of this format");
  }

  std::vector<nb::object> magnets_;
  std::deque<typename F::Coded> coded_; // a deque, because elements must keep their addresses
  std::deque<typename F::Drive> in_si_;
  std::vector<typename F::Drive *> drives_;
  std::vector<typename F::Corrected> corrected_; // corrected drives; empty without correction
  std::vector<typename F::Drive> behind_;
};

inline anhyst_biquad_f64 to_biquad(const In &row)
{
  same_length(5, row.shape(0), "a filter");
  return {{row(0), row(1), row(2)}, {row(3), row(4)}};
}

#define AXES(F, REAL, f)                                                                           \
  struct Axes##F {                                                                                 \
    using Real = REAL;                                                                             \
    using Own = RealForceController<ForceController##F>;                                           \
    using Drive = anhyst_force_controller_##f;                                                     \
    using Filter = anhyst_biquad_##f;                                                              \
    using Correction = anhyst_correction_##f;                                                      \
    using Corrected = anhyst_corrected_##f;                                                        \
    using Coded = anhyst_coded_##f;                                                                \
    using CodeScales = anhyst_code_scales_##f;                                                     \
    using Settings = anhyst_axes_settings_##f;                                                     \
    using State = anhyst_axes_##f;                                                                 \
    using Sample = anhyst_axes_sample_##f;                                                         \
    using Answer = anhyst_axes_answer_##f;                                                         \
    static constexpr auto correct = anhyst_force_controller_init_corrected_##f;                    \
    static constexpr auto code = anhyst_force_controller_init_coded_##f;                           \
    static constexpr auto init = anhyst_axes_init_##f;                                             \
    static constexpr auto tick = anhyst_axes_tick_##f;                                             \
  }
AXES(F64, double, f64);
AXES(F32, float, f32);
#undef AXES
