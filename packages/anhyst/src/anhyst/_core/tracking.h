// SPDX-License-Identifier: Apache-2.0
// The tracking controller with all that it points to, one class for each number format.
#pragma once

#include <deque>
#include <vector>

#include "anhyst/compensator/force_coded_real.h"
#include "anhyst/control/axes.h"
#include "anhyst_plant/tracking.h"
#include "force_controllers.h"
#include "gains.h"
#include "settings.h"

inline anhyst_tracking_scales take_scales(Settings &given)
{
  const anhyst_tracking_scales scales = {
      given.take<double>("error_full"),  given.take<double>("forward_full"),
      given.take<double>("demand_full"), given.take<double>("current_full"),
      given.take<double>("flux_full"),   given.take<double>("gap_low"),
      given.take<double>("gap_high"),    0.0};
  if (!(scales.error > 0.0 && scales.forward > 0.0 && scales.demand > 0.0 && scales.current > 0.0 &&
        scales.flux > 0.0 && scales.gap_low < scales.gap_high)) {
    throw std::invalid_argument("a scale of the controller is not valid");
  }
  return scales;
}

// Force controllers as the drives of one controller, each of its own.
template <class F> class Drives {
public:
  Drives() = default;
  Drives(const Drives &) = delete;
  Drives &operator=(const Drives &) = delete;

  void start(const nb::list &magnets, const anhyst_tracking_scales &scales)
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

  // Puts each drive behind what was found of its magnet, in the order of anhyst_correction.
  void correct(const InTable &rows)
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
  typename F::Drive *drive_of(nb::handle magnet, const anhyst_tracking_scales &scales)
  {
    typename F::Own *own = nullptr;
    if (nb::try_cast<typename F::Own *>(magnet, own) && own) {
      return own->get();
    }
    if constexpr (F::in_si) {
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
    }
    if constexpr (std::is_same_v<typename F::Real, double>) {
      RealForceController<ForceControllerF32> *narrow = nullptr;
      if (nb::try_cast<RealForceController<ForceControllerF32> *>(magnet, narrow) && narrow) {
        in_si_.emplace_back();
        anhyst_tracking_drive_init_f32(&in_si_.back(), narrow->get());
        return &in_si_.back();
      }
    }
    throw std::invalid_argument("each magnet has a force controller of this format");
  }

  std::vector<nb::object> magnets_;
  std::deque<typename F::Coded> coded_; // whose addresses stay
  std::deque<typename F::Drive> in_si_;
  std::vector<typename F::Drive *> drives_;
  std::vector<typename F::Corrected> corrected_; // as many as drives, or none
  std::vector<typename F::Drive> behind_;
};

template <class F> class TrackingLaw {
public:
  using Real = typename F::Real;

  // Takes what the settings say of the law; magnets are its drives.
  void start(const nb::list &magnets, const nb::list &filters, const typename F::Pid &pid,
             Settings &given, const anhyst_tracking_scales &scales)
  {
    drives_.start(magnets, scales);
    for (nb::handle filter : filters) {
      filters_.push_back(F::filter(nb::cast<typename F::Row>(filter)));
    }
    filtered_.resize(filters_.size());
    settings_.pid = pid;
    settings_.allocation.kind = given.take<uint16_t>("allocation");
    settings_.allocation.idle = given.take<Real>("idle");
    settings_.current_low = given.take<Real>("current_low");
    settings_.current_high = given.take<Real>("current_high");
    settings_.current_step = given.take<Real>("current_step");
    settings_.filter = filters_.data();
    settings_.filters = static_cast<uint16_t>(filters_.size());
    if (F::init(&tracking_, &settings_, drives_.data(), drives_.size(), filtered_.data()) !=
        ANHYST_OK) {
      throw std::invalid_argument("the settings of the controller are not valid");
    }
  }

  void correct(const InTable &rows) { drives_.correct(rows); }
  typename F::State *get() { return &tracking_; }

private:
  Drives<F> drives_;
  std::vector<typename F::Filter> filters_;
  std::vector<typename F::FilterState> filtered_;
  typename F::Settings settings_{};
  typename F::State tracking_{};
};

template <class Coefficients> Coefficients to_biquad(const In &row)
{
  same_length(5, row.shape(0), "a filter");
  using Real = std::decay_t<decltype(Coefficients{}.back[0])>;
  const auto at = [&](size_t i) { return static_cast<Real>(row(i)); };
  return {{at(0), at(1), at(2)}, {at(3), at(4)}};
}

#define TRACKING(F, REAL, f)                                                                       \
  struct Tracking##F {                                                                             \
    using Real = REAL;                                                                             \
    using Row = In;                                                                                \
    using Own = RealForceController<ForceController##F>;                                           \
    using Drive = anhyst_force_controller_##f;                                                     \
    using Pid = anhyst_pid_##f;                                                                    \
    using Filter = anhyst_biquad_##f;                                                              \
    using FilterState = anhyst_biquad_state_##f;                                                   \
    using Settings = anhyst_tracking_settings_##f;                                                 \
    using State = anhyst_tracking_##f;                                                             \
    using Adapter = anhyst_tracking_adapter_##f;                                                   \
    using Correction = anhyst_correction_##f;                                                      \
    using Corrected = anhyst_corrected_##f;                                                        \
    using Coded = anhyst_coded_##f;                                                                \
    using CodeScales = anhyst_code_scales_##f;                                                     \
    using AxesSettings = anhyst_axes_settings_##f;                                                 \
    using Axes = anhyst_axes_##f;                                                                  \
    using AxesSample = anhyst_axes_sample_##f;                                                     \
    using AxesAnswer = anhyst_axes_answer_##f;                                                     \
    static constexpr bool in_si = true;                                                            \
    static constexpr auto init = anhyst_tracking_init_##f;                                         \
    static constexpr auto correct = anhyst_force_controller_init_corrected_##f;                    \
    static constexpr auto code = anhyst_force_controller_init_coded_##f;                           \
    static constexpr auto tick = anhyst_tracking_adapter_tick_##f;                                 \
    static constexpr auto axes_init = anhyst_axes_init_##f;                                        \
    static constexpr auto axes_tick = anhyst_axes_tick_##f;                                        \
    static Filter filter(const Row &row) { return to_biquad<Filter>(row); }                        \
    static Pid pid(const Row &row) { return to_biquad<Pid>(row); }                                 \
  }
TRACKING(F64, double, f64);
TRACKING(F32, float, f32);
#undef TRACKING

struct TrackingQ31 {
  using Real = int32_t;
  using Row = GainWords;
  using Own = FixedForceController;
  using Drive = anhyst_force_controller_q31;
  using Pid = anhyst_pid_q31;
  using Filter = anhyst_biquad_q31;
  using FilterState = anhyst_biquad_state_q31;
  using Settings = anhyst_tracking_settings_q31;
  using State = anhyst_tracking_q31;
  using Adapter = anhyst_tracking_adapter_q31;
  struct Corrected {}; // there is none in fixed point
  struct Coded {};
  static constexpr bool in_si = false;
  static constexpr auto init = anhyst_tracking_init_q31;
  static constexpr auto tick = anhyst_tracking_adapter_tick_q31;
  static Filter filter(const Row &words)
  {
    same_length(12, words.shape(0), "a filter");
    const auto at = [&](size_t i) {
      return anhyst_factor{GainsQ31::half(words(2 * i)), GainsQ31::half(words(2 * i + 1))};
    };
    return {at(0), at(1), at(2), at(3), at(4), at(5)};
  }
  static Pid pid(const Row &words) { return GainsQ31::read(words); }
};
