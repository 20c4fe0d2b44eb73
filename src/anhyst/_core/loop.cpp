// SPDX-License-Identifier: Apache-2.0
// A bearing and its controller in lock-step.
#include <nanobind/stl/optional.h>

#include "anhyst_plant/loop.h"
#include "plant.h"
#include "position.h"

namespace {

using Commands = nb::ndarray<const uint32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

class Loop {
public:
  Loop(Bearing &bearing, LoopController &controller, const nb::dict &current_loop, bool has_hall)
  {
    Settings given(current_loop);
    loop_.bearing = bearing.settings();
    loop_.state = bearing.state();
    loop_.controller = controller.handle();
    loop_.current_loop = {given.take<double>("resistance"), given.take<double>("gain"),
                          given.take<double>("reset"), given.take<double>("limit")};
    loop_.has_hall = has_hall;
    given.finish();
  }

  OutTable run(const In &target, const In &load, const In &inject, const In &feed,
               const Commands &command, const std::optional<In> &frame)
  {
    const size_t n = target.shape(0);
    same_length(n, load.shape(0), "load");
    same_length(n, inject.shape(0), "inject");
    same_length(n, feed.shape(0), "feed");
    same_length(n, command.shape(0), "command");
    if (frame) {
      same_length(n + 1, frame->shape(0), "frame");
    }
    std::vector<double> record(n * ANHYST_LOOP_COLUMNS);
    const anhyst_plant_events events = {target.data(),  load.data(),
                                        inject.data(),  feed.data(),
                                        command.data(), frame ? frame->data() : nullptr};
    size_t rows;
    {
      nb::gil_scoped_release release;
      rows = anhyst_plant_loop_run(&loop_, &events, n, record.data());
    }
    OutTable out = make_table(rows, ANHYST_LOOP_COLUMNS);
    std::copy(record.begin(), record.begin() + static_cast<long>(rows * ANHYST_LOOP_COLUMNS),
              out.data());
    return out;
  }

private:
  anhyst_plant_loop loop_{};
};

} // namespace

void bind_loop(nb::module_ &m)
{
  m.attr("LOOP_COLUMNS") = ANHYST_LOOP_NAMES;
  nb::class_<Loop>(m, "BearingLoop")
      .def(nb::init<Bearing &, LoopController &, const nb::dict &, bool>(), "bearing"_a,
           "controller"_a, "current_loop"_a, "has_hall"_a, nb::keep_alive<1, 2>(),
           nb::keep_alive<1, 3>())
      .def("run", &Loop::run, "target"_a.noconvert(), "load"_a.noconvert(), "inject"_a.noconvert(),
           "feed"_a.noconvert(), "command"_a.noconvert(), "frame"_a = nb::none());
}
