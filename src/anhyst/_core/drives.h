// SPDX-License-Identifier: Apache-2.0
// Drives with the tables they point to, one class for each number format.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "anhyst/drive.h"
#include "anhyst/drive_real.h"
#include "arrays.h"
#include "real_parameters.h"

struct DriveF64 {
  using Real = double;
  using Format = Double;
  using Map = anhyst_map_f64;
  using Loop = anhyst_flux_loop_f64;
  using State = anhyst_drive_f64;
  static constexpr auto init_map = anhyst_drive_init_map_f64;
  static constexpr auto init_compensator = anhyst_drive_init_compensator_f64;
  static constexpr auto init_flux = anhyst_drive_init_flux_f64;
  static constexpr auto solve = anhyst_drive_solve_f64;
  static constexpr auto commit = anhyst_drive_commit_f64;
  static constexpr auto conditioning_length = anhyst_drive_conditioning_length_f64;
  static constexpr auto conditioning = anhyst_drive_conditioning_f64;
};

struct DriveF32 {
  using Real = float;
  using Format = Single;
  using Map = anhyst_map_f32;
  using Loop = anhyst_flux_loop_f32;
  using State = anhyst_drive_f32;
  static constexpr auto init_map = anhyst_drive_init_map_f32;
  static constexpr auto init_compensator = anhyst_drive_init_compensator_f32;
  static constexpr auto init_flux = anhyst_drive_init_flux_f32;
  static constexpr auto solve = anhyst_drive_solve_f32;
  static constexpr auto commit = anhyst_drive_commit_f32;
  static constexpr auto conditioning_length = anhyst_drive_conditioning_length_f32;
  static constexpr auto conditioning = anhyst_drive_conditioning_f32;
};

inline void sound_drive(anhyst_status status)
{
  if (status != ANHYST_OK) {
    throw std::invalid_argument("the parameters of the drive are not sound");
  }
}

// In floating point.
template <class F> class RealDrive {
public:
  using Real = typename F::Real;
  using Made = std::unique_ptr<RealDrive>;

  RealDrive(const RealDrive &) = delete;
  RealDrive &operator=(const RealDrive &) = delete;

  static Made map(const InTable &entries, double force_high, double gap_low, double gap_high,
                  double low, double high)
  {
    Made drive(new RealDrive);
    drive->current_ = drive->table(entries, force_high, gap_low, gap_high);
    sound_drive(F::init_map(&drive->state_, &drive->current_, real(low), real(high)));
    return drive;
  }

  static Made compensator(const Owned<typename F::Format> &parameters)
  {
    Made drive(new RealDrive);
    sound_drive(F::init_compensator(&drive->state_, parameters.get()));
    return drive;
  }

  static Made flux(const InTable &entries, const InTable &wanted, const In &loop, double force_high,
                   double gap_low, double gap_high, double low, double high)
  {
    same_length(4, loop.shape(0), "loop");
    Made drive(new RealDrive);
    drive->current_ = drive->table(entries, force_high, gap_low, gap_high);
    drive->loop_ = {drive->table(wanted, force_high, gap_low, gap_high), real(loop(0)),
                    real(loop(1)), real(loop(2)), real(loop(3))};
    sound_drive(
        F::init_flux(&drive->state_, &drive->current_, &drive->loop_, real(low), real(high)));
    return drive;
  }

  Real solve(double demand, double gap, double density)
  {
    return F::solve(&state_, real(demand), real(gap), real(density));
  }
  Real commit(double applied, double gap) { return F::commit(&state_, real(applied), real(gap)); }
  int flags() const { return state_.flags; }
  int32_t conditioning_length() const { return F::conditioning_length(&state_); }
  Real conditioning(int32_t tick) const { return F::conditioning(&state_, tick); }
  // For a controller that runs it; lives as long as this object.
  typename F::State *get() { return &state_; }

private:
  RealDrive() = default;

  static Real real(double value) { return static_cast<Real>(value); }

  typename F::Map table(const InTable &entries, double force_high, double gap_low, double gap_high)
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
            real(force_high),
            real(gap_low),
            real(gap_high)};
  }

  typename F::State state_{};
  typename F::Map current_{};
  typename F::Loop loop_{};
  std::vector<std::vector<Real>> tables_;
};

// In fixed point, all signals q31.
class FixedDrive {
public:
  using Made = std::unique_ptr<FixedDrive>;
  using Entries = nb::ndarray<const int16_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
  using Words = nb::ndarray<const int16_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
  using Factors = nb::ndarray<const int16_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

  FixedDrive(const FixedDrive &) = delete;
  FixedDrive &operator=(const FixedDrive &) = delete;

  static Made map(const Entries &entries, int32_t low, int32_t high);
  static Made compensator(const std::string &kind, const Words &words);
  static Made flux(const Entries &entries, const Entries &wanted, const Factors &loop, int32_t low,
                   int32_t high);

  int32_t solve(int32_t demand, int32_t gap, int32_t density)
  {
    return anhyst_drive_solve_q31(&state_, demand, gap, density);
  }
  int32_t commit(int32_t applied, int32_t gap)
  {
    return anhyst_drive_commit_q31(&state_, applied, gap);
  }
  int flags() const { return state_.flags; }
  int32_t conditioning_length() const { return anhyst_drive_conditioning_length_q31(&state_); }
  int32_t conditioning(int32_t tick) const { return anhyst_drive_conditioning_q31(&state_, tick); }
  // For a controller that runs it; lives as long as this object.
  anhyst_drive_q31 *get() { return &state_; }

private:
  FixedDrive() = default;

  anhyst_map_q31 table(const Entries &entries);

  anhyst_drive_q31 state_{};
  anhyst_map_q31 current_{};
  anhyst_flux_loop_q31 loop_{};
  std::vector<std::vector<int16_t>> tables_;
};

const anhyst_kernel *to_kernel(const std::string &kind);
