// SPDX-License-Identifier: Apache-2.0
// The controller of a stage in fixed point; its words are integers.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <limits>
#include <vector>

#include <nanobind/stl/vector.h>

#include "anhyst/control/axes_fixed.h"
#include "anhyst_plant/axes.h"
#include "force_controllers.h"
#include "position.h"
#include "settings.h"

namespace {

using Codes = std::vector<int32_t>;

// Integer tables by name; the copies exist as long as this object.
class Words : public Settings {
public:
  using Settings::Settings;

  template <class T> const T *table(const std::string &name, size_t rows, size_t columns)
  {
    const auto found = take<nb::ndarray<const T, nb::ndim<2>, nb::c_contig, nb::device::cpu>>(name);
    same_length(rows, found.shape(0), name.c_str());
    same_length(columns, found.shape(1), name.c_str());
    kept_.emplace_back(found); // a copy if the rows in Python are not contiguous
    return found.data();
  }
  const int32_t *code_table(const std::string &name, size_t rows, size_t columns)
  {
    return table<int32_t>(name, rows, columns);
  }
  anhyst_rows_q31 matrix(const std::string &name, size_t rows, size_t columns)
  {
    return {code_table(name, rows, columns), table<uint16_t>(name + "_shift", rows, 1)};
  }

private:
  std::vector<nb::ndarray<nb::ro>> kept_;
};

anhyst_wrench_layout_q31 read_layout(Words &words, Settings &given)
{
  const auto axes = given.take<uint16_t>("axes");
  const auto drives = given.take<uint16_t>("drives");
  return {axes,
          drives,
          words.table<uint16_t>("against", drives, 1),
          {words.matrix("whole", drives, axes), words.code_table("whole_apart", drives, drives)},
          {words.matrix("yields", drives, axes), words.code_table("yields_apart", drives, drives)},
          {given.take<int32_t>("idle"), given.take<uint16_t>("allocation")},
          given.take<int32_t>("least"),
          given.take<int32_t>("most")};
}

// Allocation of a wrench to the drives, in codes.
class FixedWrench {
public:
  FixedWrench(const nb::dict &words, const nb::dict &settings) : words_(words)
  {
    Settings given(settings);
    layout_ = read_layout(words_, given);
    given.finish();
    words_.finish();
    if (anhyst_wrench_init_q31(&wrench_, &layout_) != ANHYST_OK) {
      throw std::invalid_argument("these words are no drives");
    }
  }
  void lose(int drive) { anhyst_wrench_lose_q31(&wrench_, drive); }
  nb::tuple share(const Codes &wrench) const
  {
    same_length(wrench.size(), layout_.axes, "wrench");
    Codes force(layout_.drives);
    const bool made = anhyst_wrench_share_q31(&wrench_, wrench.data(), force.data()) != 0;
    return nb::make_tuple(force, made);
  }

private:
  Words words_;
  anhyst_wrench_layout_q31 layout_{};
  anhyst_wrench_q31 wrench_{};
};

// Returns the nearest code of a signal, or Q31_MIN for NaN; equals support/fixed_point.py.
int32_t to_code(double value, double full)
{
  const double place = std::floor(value / full * 2147483648.0 + 0.5);
  if (std::isnan(place)) {
    return ANHYST_Q31_MIN;
  }
  return static_cast<int32_t>(std::clamp(place, -2147483647.0, 2147483647.0));
}

class FixedAxes : public LoopController {
public:
  FixedAxes(const nb::list &magnets, const nb::dict &words, const nb::dict &settings,
            const nb::dict &scales)
      : words_(words)
  {
    Settings given(settings);
    settings_.layout = read_layout(words_, given);
    const size_t axes = settings_.layout.axes;
    const size_t heads = given.take<uint16_t>("heads");
    settings_.heads = static_cast<uint16_t>(heads);
    settings_.see = words_.matrix("see", axes, heads);
    settings_.decouple = words_.matrix("decouple", axes, axes);
    settings_.weigh = words_.matrix("weigh", axes, axes);
    settings_.without = words_.matrix("without", heads * axes, heads);
    settings_.reach = words_.code_table("reach", axes, 1);
    settings_.land = words_.code_table("land", axes, 1);
    settings_.lift = words_.code_table("lift", axes, 1);
    const int32_t *pid = words_.code_table("pid", axes, 5);
    for (const int32_t *p = pid; p != pid + 5 * axes; p += 5) {
      pid_.push_back({p[0], p[1], p[2], p[3], static_cast<uint16_t>(p[4])});
    }
    settings_.pid = pid_.data();
    settings_.current_low = given.take<int32_t>("current_low");
    settings_.current_high = given.take<int32_t>("current_high");
    settings_.current_step = given.take<int32_t>("current_step");
    settings_.follow = given.take<int32_t>("follow");
    settings_.slew = given.take<int32_t>("slew");
    settings_.off = given.take<int32_t>("off");
    settings_.off_ticks = given.take<uint16_t>("off_ticks");
    settings_.spare = given.take<uint16_t>("spare");
    settings_.land_ticks = given.take<uint16_t>("land_ticks");
    settings_.spare_heads = given.take<uint16_t>("spare_heads");
    settings_.jump = given.take<int32_t>("jump");
    settings_.doubt = given.take<uint16_t>("doubt");
    settings_.noisy = given.take<uint16_t>("noisy");
    given.finish();
    words_.finish();
    Settings full(scales);
    at_ = full.take<std::vector<double>>("at");
    wrench_full_ = full.take<std::vector<double>>("wrench");
    same_length(heads * axes, at_.size(), "at");
    same_length(axes, wrench_full_.size(), "wrench");
    head_full_ = full.take<double>("head");
    current_full_ = full.take<double>("current");
    flux_full_ = full.take<double>("flux");
    gap_low_ = full.take<double>("gap_low");
    gap_range_ = full.take<double>("gap_high") - gap_low_;
    full.finish();
    for (nb::handle magnet : magnets) {
      magnets_.push_back(nb::borrow(magnet));
      drives_.push_back(nb::cast<FixedForceController *>(magnet)->get());
    }
    same_length(drives_.size(), settings_.layout.drives, "magnets");
    current_.resize(drives_.size());
    demand_.resize(axes);
    if (anhyst_axes_init_q31(&axes_, &settings_, drives_.data()) != ANHYST_OK) {
      throw std::invalid_argument("the settings of the controller are not valid");
    }
  }

  anhyst_loop_controller handle() override { return {this, loop_tick}; }

  // Runs one tick in codes; returns currents, wrench, flags, lost drives, state.
  nb::tuple tick(const Codes &head, const Codes &forward, const Codes &gap, const Codes &read,
                 uint16_t command)
  {
    same_length(settings_.heads, head.size(), "head");
    same_length(demand_.size(), forward.size(), "forward");
    same_length(drives_.size(), gap.size(), "gap");
    same_length(drives_.size(), read.size(), "read");
    const Codes flux(gap.size(), ANHYST_NO_FLUX);
    const auto out = run(head, forward, gap, flux, read, command);
    return nb::make_tuple(current_, demand_, out.flags, out.lost, out.state);
  }

private:
  anhyst_axes_answer_q31 run(const Codes &head, const Codes &forward, const Codes &gap,
                             const Codes &flux, const Codes &read, uint16_t command)
  {
    const anhyst_axes_sample_q31 in = {head.data(), forward.data(), gap.data(), flux.data(),
                                       read.data(), command,        nullptr};
    anhyst_axes_answer_q31 out = {current_.data(), demand_.data(), 0, 0, 0};
    anhyst_axes_tick_q31(&axes_, &in, &out);
    return out;
  }

  // Tick for a simulated loop; see TrackingAxes.
  static void loop_tick(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer)
  {
    auto &c = *static_cast<FixedAxes *>(self);
    const size_t axes = c.demand_.size();
    const size_t drives = c.current_.size();
    Codes head, forward, gap, flux, read;
    for (size_t i = 0; i < c.settings_.heads; i++) {
      double off = sample->head[drives + i];
      for (size_t j = 0; j < axes; j++) {
        off -= c.at_[i * axes + j] * sample->target[j];
      }
      head.push_back(to_code(off, c.head_full_));
    }
    for (size_t j = 0; j < axes; j++) {
      forward.push_back(to_code(sample->load[j], c.wrench_full_[j]));
    }
    for (size_t i = 0; i < drives; i++) {
      gap.push_back(
          to_code(std::clamp(sample->head[i] - c.gap_low_, 0.0, c.gap_range_), c.gap_range_));
      flux.push_back(to_code(sample->flux[i], c.flux_full_));
      read.push_back(to_code(sample->current[i], c.current_full_));
    }
    const auto out = c.run(head, forward, gap, flux, read, static_cast<uint16_t>(sample->command));
    answer->flags = out.flags;
    answer->state = anhyst_axes_state_word(out.state, out.lost);
    for (size_t i = 0; i < drives; i++) {
      answer->current[i] = c.current_[i] / 2147483648.0 * c.current_full_;
    }
    for (size_t j = 0; j < axes; j++) {
      answer->demand[j] = c.demand_[j] / 2147483648.0 * c.wrench_full_[j];
    }
    std::copy(sample->target, sample->target + axes, answer->reference);
  }

  Words words_;
  std::vector<nb::object> magnets_;
  std::vector<anhyst_force_controller_q31 *> drives_;
  std::vector<double> at_, wrench_full_;
  double head_full_{}, current_full_{}, flux_full_{}, gap_low_{}, gap_range_{};
  Codes current_, demand_;
  std::vector<anhyst_axis_pid_q31> pid_;
  anhyst_axes_settings_q31 settings_{};
  anhyst_axes_q31 axes_{};
};

} // namespace

void bind_axes_fixed(nb::module_ &m)
{
  nb::class_<FixedWrench>(m, "FixedWrench")
      .def(nb::init<const nb::dict &, const nb::dict &>(), "words"_a, "settings"_a)
      .def("lose", &FixedWrench::lose, "drive"_a)
      .def("share", &FixedWrench::share, "wrench"_a);
  nb::class_<FixedAxes, LoopController>(m, "FixedAxes")
      .def(nb::init<const nb::list &, const nb::dict &, const nb::dict &, const nb::dict &>(),
           "magnets"_a, "words"_a, "settings"_a, "scales"_a)
      .def("tick", &FixedAxes::tick, "head"_a, "forward"_a, "gap"_a, "read"_a, "command"_a = 0);
}
