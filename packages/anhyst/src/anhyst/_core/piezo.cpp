// SPDX-License-Identifier: Apache-2.0
// A piezo stage, alone and with its controller.
#include "anhyst_plant/piezo.h"

#include <nanobind/stl/optional.h>

#include <memory>

#include "tracking.h"

namespace {

// The controller, together with the data it points to.
class PiezoController {
public:
  PiezoController(nb::handle drive, const nb::list &filters, const In &pid, Settings &given)
  {
    nb::list drives;
    drives.append(drive);
    drives_.add_magnets(drives, read_scales(given));
    for (nb::handle filter : filters) {
      filters_.push_back(to_biquad(nb::cast<In>(filter)));
    }
    filtered_.resize(filters_.size());
    settings_ = {to_biquad(pid),
                 given.take<double>("current_low"),
                 given.take<double>("current_high"),
                 given.take<double>("current_step"),
                 filters_.data(),
                 static_cast<uint16_t>(filters_.size())};
    if (anhyst_tracking_init(&tracking_, &settings_, drives_.data()[0], filtered_.data()) !=
        ANHYST_OK) {
      throw std::invalid_argument("the settings of the controller are not valid");
    }
  }
  PiezoController(const PiezoController &) = delete;

  anhyst_tracking *get() { return &tracking_; }

private:
  Drives<AxesF64> drives_;
  std::vector<anhyst_biquad_f64> filters_;
  std::vector<anhyst_biquad_state_f64> filtered_;
  anhyst_tracking_settings settings_{};
  anhyst_tracking tracking_{};
};

class PiezoMotion {
public:
  PiezoMotion(const nb::dict &stage, const In &creep_times, const In &creep_shares)
  {
    Settings given(stage);
    const size_t creeps = creep_times.shape(0);
    same_length(creeps, creep_shares.shape(0), "creep_shares");
    if (creeps > ANHYST_PIEZO_MAX_CREEP_TERMS) {
      throw std::invalid_argument("a stack creeps in at most 8 terms");
    }
    piezo_.stroke_per_volt = given.take<double>("stroke_per_volt");
    piezo_.bend = given.take<double>("bend");
    piezo_.slope = given.take<double>("slope");
    piezo_.beta = given.take<double>("beta");
    piezo_.gamma = given.take<double>("gamma");
    piezo_.omega = given.take<double>("omega");
    piezo_.damping = given.take<double>("damping");
    piezo_.kept = given.take<double>("kept");
    piezo_.step = given.take<double>("step");
    piezo_.steps = given.take<int>("steps");
    given.finish();
    piezo_.creeps = static_cast<int>(creeps);
    std::copy(creep_times.data(), creep_times.data() + creeps, piezo_.creep_time);
    std::copy(creep_shares.data(), creep_shares.data() + creeps, piezo_.creep_share);
  }

  // Returns the position at each tick, at which a new command begins, after a long rest.
  Out run(const In &command) const
  {
    anhyst_piezo_state state{};
    Out out = make_array(command.shape(0));
    for (size_t i = 0; i < command.shape(0); i++) {
      out.data()[i] = state.place;
      anhyst_piezo_advance(&piezo_, &state, command(i), 0.0);
    }
    return out;
  }

  const anhyst_piezo &numbers() const { return piezo_; }

private:
  anhyst_piezo piezo_{};
};

class PiezoLoop {
public:
  PiezoLoop(const PiezoMotion &motion, double sensor_step) : piezo_(motion.numbers())
  {
    loop_.piezo = &piezo_;
    loop_.sensor_step = sensor_step;
  }

  // Starts a controller at rest, or takes over from the previous one and changes its integral.
  void control(nb::handle drive, const nb::list &filters, const In &pid, const nb::dict &settings,
               std::optional<double> change)
  {
    Settings given(settings);
    auto law = std::make_unique<PiezoController>(drive, filters, pid, given);
    given.finish();
    anhyst_tracking *next = law->get();
    if (change && law_) {
      const anhyst_tracking *last = law_->get();
      same_length(last->settings->filters, next->settings->filters, "filters");
      std::copy(last->filtered, last->filtered + last->settings->filters, next->filtered);
      next->state = last->state;
      next->state.delayed[0] += *change;
    }
    law_ = std::move(law);
    loop_.controller = next;
  }

  OutTable run(const In &wanted, const In &expected, const In &noise, const In &load)
  {
    if (!law_) {
      throw std::invalid_argument("no controller is in force");
    }
    const size_t n = wanted.shape(0);
    same_length(n, expected.shape(0), "expected");
    same_length(n, noise.shape(0), "noise");
    same_length(n, load.shape(0), "load");
    OutTable out = make_table(n, ANHYST_PIEZO_COLUMNS);
    nb::gil_scoped_release release;
    for (size_t i = 0; i < n; i++) {
      const anhyst_piezo_event event = {wanted.data()[i], expected.data()[i], noise.data()[i],
                                        load.data()[i]};
      anhyst_piezo_loop_tick(&loop_, &event, out.data() + i * ANHYST_PIEZO_COLUMNS);
    }
    return out;
  }

private:
  anhyst_piezo piezo_;
  anhyst_piezo_loop loop_{};
  std::unique_ptr<PiezoController> law_;
};

} // namespace

void bind_piezo(nb::module_ &m)
{
  nb::class_<PiezoMotion>(m, "PiezoMotion")
      .def(nb::init<const nb::dict &, const In &, const In &>(), "stage"_a,
           "creep_times"_a.noconvert(), "creep_shares"_a.noconvert())
      .def("run", &PiezoMotion::run, "command"_a.noconvert());
  nb::class_<PiezoLoop>(m, "PiezoLoop")
      .def(nb::init<const PiezoMotion &, double>(), "motion"_a, "sensor_step"_a)
      .def("control", &PiezoLoop::control, "drive"_a, "filters"_a, "pid"_a.noconvert(),
           "settings"_a, "change"_a = nb::none())
      .def("run", &PiezoLoop::run, "wanted"_a.noconvert(), "expected"_a.noconvert(),
           "noise"_a.noconvert(), "load"_a.noconvert());
}
