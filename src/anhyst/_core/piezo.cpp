// SPDX-License-Identifier: Apache-2.0
// A piezo stage, alone and with its controller.
#include "anhyst_plant/piezo.h"

#include "tracking.h"

namespace {

class PiezoMotion {
public:
  PiezoMotion(const nb::dict &stage, const In &creep_times, const In &creep_shares)
  {
    Settings given(stage);
    const size_t creeps = creep_times.shape(0);
    same_length(creeps, creep_shares.shape(0), "creep_shares");
    if (creeps > ANHYST_PIEZO_CREEPS) {
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

  // From long rest: where the stage is at each tick, whose command then holds.
  Out run(const In &command) const
  {
    anhyst_piezo_state state{};
    Out out = make_array(command.shape(0));
    for (size_t i = 0; i < command.shape(0); i++) {
      out.data()[i] = state.place;
      anhyst_piezo_advance(&piezo_, &state, command(i));
    }
    return out;
  }

  OutTable follow(nb::handle drive, const nb::list &filters, const In &pid,
                  const nb::dict &settings, const In &wanted, const In &expected,
                  const In &noise) const
  {
    const size_t n = wanted.shape(0);
    same_length(n, expected.shape(0), "expected");
    same_length(n, noise.shape(0), "noise");
    Settings given(settings);
    const anhyst_tracking_scales scales = take_scales(given);
    const double step = given.take<double>("sensor_step");
    nb::list drives;
    drives.append(drive);
    TrackingLaw<TrackingF64> law;
    law.start(drives, filters, TrackingF64::pid(pid), given, scales);
    given.finish();
    const anhyst_piezo_events events = {wanted.data(), expected.data(), noise.data(), step};
    OutTable out = make_table(n, ANHYST_PIEZO_COLUMNS);
    nb::gil_scoped_release release;
    anhyst_piezo_run(&piezo_, law.get(), &events, n, out.data());
    return out;
  }

private:
  anhyst_piezo piezo_{};
};

} // namespace

void bind_piezo(nb::module_ &m)
{
  nb::class_<PiezoMotion>(m, "PiezoMotion")
      .def(nb::init<const nb::dict &, const In &, const In &>(), "stage"_a,
           "creep_times"_a.noconvert(), "creep_shares"_a.noconvert())
      .def("run", &PiezoMotion::run, "command"_a.noconvert())
      .def("follow", &PiezoMotion::follow, "drive"_a, "filters"_a, "pid"_a.noconvert(),
           "settings"_a, "wanted"_a.noconvert(), "expected"_a.noconvert(), "noise"_a.noconvert());
}
