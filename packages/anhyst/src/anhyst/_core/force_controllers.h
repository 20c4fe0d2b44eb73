// SPDX-License-Identifier: Apache-2.0
// Force controllers, together with the tables they point to; one class for each number format.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "anhyst/compensator/force_by_play.h"
#include "anhyst/compensator/force_by_play_real.h"
#include "anhyst/compensator/force_corrected_real.h"
#include "anhyst/control/coil_flux.h"
#include "anhyst/control/coil_flux_real.h"
#include "anhyst/numeric/wide.h"
#include "arrays.h"
#include "formats.h"

#define FORCE_CONTROLLER(F, REAL, f)                                                               \
  struct ForceController##F {                                                                      \
    using Real = REAL;                                                                             \
    using Format = F;                                                                              \
    using Map = anhyst_map_##f;                                                                    \
    using Loop = anhyst_flux_loop_##f;                                                             \
    using Play = anhyst_play_map_##f;                                                              \
    using State = anhyst_force_controller_##f;                                                     \
    using Coil = anhyst_coil_flux_##f;                                                             \
    using CoilSettings = anhyst_coil_flux_settings_##f;                                            \
    static constexpr auto init_coil = anhyst_force_controller_init_coil_##f;                       \
    static constexpr auto init_map = anhyst_force_controller_init_map_##f;                         \
    static constexpr auto init_compensator = anhyst_force_controller_init_compensator_##f;         \
    static constexpr auto init_flux = anhyst_force_controller_init_flux_##f;                       \
    static constexpr auto fuse = anhyst_force_controller_fuse_##f;                                 \
    static constexpr auto make_play = anhyst_play_map_init_##f;                                    \
    static constexpr auto init_play = anhyst_force_controller_init_play_##f;                       \
    static constexpr auto solve = anhyst_force_controller_solve_##f;                               \
    static constexpr auto commit = anhyst_force_controller_commit_##f;                             \
    static constexpr auto conditioning_length = anhyst_force_controller_conditioning_length_##f;   \
    static constexpr auto conditioning = anhyst_force_controller_conditioning_##f;                 \
  }
FORCE_CONTROLLER(F64, double, f64);
FORCE_CONTROLLER(F32, float, f32);
#undef FORCE_CONTROLLER

inline void check_controller(anhyst_status status)
{
  if (status != ANHYST_OK) {
    throw std::invalid_argument("the parameters of the force controller are not valid");
  }
}

// A force controller in floating point.
template <class F> class RealForceController {
public:
  using Real = typename F::Real;
  using Made = std::unique_ptr<RealForceController>;

  RealForceController(const RealForceController &) = delete;
  RealForceController &operator=(const RealForceController &) = delete;

  static Made map(const InTable &entries, double force_low, double force_high, double gap_low,
                  double gap_high, double low, double high)
  {
    Made made(new RealForceController);
    made->current_ = made->table(entries, force_low, force_high, gap_low, gap_high);
    check_controller(F::init_map(&made->state_, &made->current_, real(low), real(high)));
    return made;
  }

  static Made play(const Words<typename F::Format> &words)
  {
    Made made(new RealForceController);
    made->tables_.emplace_back(words.data(), words.data() + words.size());
    check_controller(F::make_play(&made->play_, made->tables_.back().data(),
                                  static_cast<uint16_t>(words.size())));
    F::init_play(&made->state_, &made->play_);
    return made;
  }

  static Made compensator(const std::string &kind, const Words<typename F::Format> &words)
  {
    Made made(new RealForceController);
    made->tables_.emplace_back(words.data(), words.data() + words.size());
    check_controller(F::init_compensator(&made->state_, to_kernel<typename F::Format>(kind),
                                         made->tables_.back().data(),
                                         static_cast<uint32_t>(words.size())));
    return made;
  }

  static Made flux(const InTable &entries, const InTable &wanted, const In &loop, double force_low,
                   double force_high, double gap_low, double gap_high, double low, double high)
  {
    Made made(new RealForceController);
    made->current_ = made->table(entries, force_low, force_high, gap_low, gap_high);
    made->take_loop(wanted, loop, 0.0, force_low, force_high, gap_low, gap_high);
    check_controller(
        F::init_flux(&made->state_, &made->current_, &made->loop_, real(low), real(high)));
    return made;
  }

  // Corrects a compensator by the measured flux.
  void fuse(const InTable &wanted, const In &loop, double most, double force_low, double force_high,
            double gap_low, double gap_high, double low, double high)
  {
    take_loop(wanted, loop, most, force_low, force_high, gap_low, gap_high);
    check_controller(F::fuse(&state_, &loop_, real(low), real(high)));
  }

  // Estimates the flux from the voltage of a coil, in front of the method of this controller.
  void sense(const In &settings)
  {
    same_length(12, settings.shape(0), "settings");
    const auto at = [&](size_t i) { return real(settings(i)); };
    const typename F::CoilSettings given = {at(0), at(1), at(2), at(3), at(4),  at(5),
                                            at(6), at(7), at(8), at(9), at(10), at(11)};
    behind_ = state_;
    check_controller(F::init_coil(&state_, &coil_, &given, &behind_));
  }
  // Returns the flux of the law and the estimated flux in Wb, the offset in Wb per tick, and the
  // resistance in Wb per tick and A.
  std::array<double, 4> estimate() const
  {
    return {coil_.law, coil_.law + coil_.deviation, coil_.offset, coil_.resistance};
  }

  Real solve(double demand, double gap, double density)
  {
    return F::solve(&state_, real(demand), real(gap), real(density));
  }
  Real commit(double applied, double gap) { return F::commit(&state_, real(applied), real(gap)); }
  // Commits a path, and returns the expected forces.
  Out follow(const In &applied, const In &gap)
  {
    same_length(applied.shape(0), gap.shape(0), "gap");
    Out out = make_array(applied.shape(0));
    for (size_t i = 0; i < applied.shape(0); i++) {
      out.data()[i] = commit(applied(i), gap(i));
    }
    return out;
  }
  int flags() const { return state_.flags; }
  int32_t conditioning_length() const { return F::conditioning_length(&state_); }
  Real conditioning(int32_t tick) const { return F::conditioning(&state_, tick); }
  // Pointer for a position controller that runs this object; valid as long as the object exists.
  typename F::State *get() { return &state_; }

private:
  RealForceController() = default;

  static Real real(double value) { return static_cast<Real>(value); }

  typename F::Map table(const InTable &entries, double force_low, double force_high, double gap_low,
                        double gap_high)
  {
    if (entries.shape(0) < 2 || entries.shape(1) < 2 || entries.shape(0) > 65 ||
        entries.shape(1) > 4097) {
      throw std::invalid_argument("a map has 2 to 65 rows of 2 to 4097 entries");
    }
    std::vector<Real> copy(entries.size());
    for (size_t i = 0; i < copy.size(); i++) {
      copy[i] = real(entries.data()[i]);
    }
    tables_.push_back(std::move(copy));
    return {tables_.back().data(),
            static_cast<uint16_t>(entries.shape(1) - 1),
            static_cast<uint16_t>(entries.shape(0) - 1),
            real(force_low),
            real(force_high),
            real(gap_low),
            real(gap_high)};
  }

  void take_loop(const InTable &wanted, const In &loop, double most, double force_low,
                 double force_high, double gap_low, double gap_high)
  {
    same_length(4, loop.shape(0), "loop");
    loop_ = {table(wanted, force_low, force_high, gap_low, gap_high),
             real(loop(0)),
             real(loop(1)),
             real(loop(2)),
             real(loop(3)),
             real(most)};
  }

  typename F::State state_{};
  typename F::State behind_{}; // with a coil: the method that gets the estimated flux
  typename F::Coil coil_{};
  typename F::Map current_{};
  typename F::Loop loop_{};
  typename F::Play play_{};
  std::vector<std::vector<Real>> tables_;
};

// A force controller in fixed point; all signals are q31.
class FixedForceController {
public:
  using Made = std::unique_ptr<FixedForceController>;
  using Entries = nb::ndarray<const int16_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
  using Factors = nb::ndarray<const int16_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
  using Codes = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

  FixedForceController(const FixedForceController &) = delete;
  FixedForceController &operator=(const FixedForceController &) = delete;

  static Made map(const Entries &entries, int32_t low, int32_t high);
  static Made play(const Words<Fixed> &words);
  static Made compensator(const std::string &kind, const Words<Fixed> &words);
  static Made flux(const Entries &entries, const Entries &wanted, const Factors &loop, int32_t low,
                   int32_t high);

  // Corrects a compensator by the measured flux.
  void fuse(const Entries &wanted, const Factors &loop, int32_t most, int32_t low, int32_t high);

  // Estimates the flux from the voltage of a coil, in front of the method of this controller.
  void sense(const Codes &settings);
  // Flux of the law, estimated flux, offset and resistance, as fractions of full scale.
  std::array<double, 4> estimate() const;

  int32_t solve(int32_t demand, int32_t gap, int32_t density)
  {
    return anhyst_force_controller_solve_q31(&state_, demand, gap, density);
  }
  int32_t commit(int32_t applied, int32_t gap)
  {
    return anhyst_force_controller_commit_q31(&state_, applied, gap);
  }
  // Commits a path, and returns the expected forces as q31 codes.
  Out follow(const In &applied, const In &gap)
  {
    same_length(applied.shape(0), gap.shape(0), "gap");
    Out out = make_array(applied.shape(0));
    for (size_t i = 0; i < applied.shape(0); i++) {
      out.data()[i] = commit(static_cast<int32_t>(applied(i)), static_cast<int32_t>(gap(i)));
    }
    return out;
  }
  int flags() const { return state_.flags; }
  int32_t conditioning_length() const
  {
    return anhyst_force_controller_conditioning_length_q31(&state_);
  }
  int32_t conditioning(int32_t tick) const
  {
    return anhyst_force_controller_conditioning_q31(&state_, tick);
  }
  // Pointer for a position controller that runs this object; valid as long as the object exists.
  anhyst_force_controller_q31 *get() { return &state_; }

private:
  FixedForceController() = default;

  anhyst_map_q31 table(const Entries &entries);
  void take_loop(const Entries &wanted, const Factors &loop, int32_t most);

  anhyst_force_controller_q31 state_{};
  anhyst_force_controller_q31 behind_{}; // with a coil: the method that gets the estimated flux
  anhyst_coil_flux_q31 coil_{};
  anhyst_map_q31 current_{};
  anhyst_flux_loop_q31 loop_{};
  anhyst_play_map_q31 play_{};
  std::vector<std::vector<int16_t>> tables_;
};
