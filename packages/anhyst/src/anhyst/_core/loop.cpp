// SPDX-License-Identifier: Apache-2.0
// A plant and its controller in lock-step.
#include <nanobind/stl/optional.h>

#include <memory>

#include "anhyst_plant/loop.h"
#include "plant.h"
#include "position.h"

namespace {

using Commands = nb::ndarray<const uint32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

class Loop {
public:
  Loop(Plant &plant, LoopController &controller, const std::vector<nb::dict> &current_loops)
  {
    const anhyst_plant_body *body = plant.body();
    same_length(current_loops.size(), static_cast<size_t>(body->magnets), "current loops");
    for (const nb::dict &one : current_loops) {
      Settings given(one);
      current_loops_.push_back({given.take<double>("resistance"), given.take<double>("gain"),
                                given.take<double>("reset"), given.take<double>("limit"), 0.0});
      given.finish();
    }
    room_.resize(static_cast<size_t>(
        ANHYST_LOOP_STORAGE_SIZE(body->magnets, body->heads, body->coordinates)));
    loop_ = {body, plant.state(), controller.handle(), current_loops_.data(), room_.data(), 0};
  }

  // Returns, for each column, signal, unit, and number of the magnet, head or coordinate.
  nb::list signals() const
  {
    const anhyst_plant_body *body = loop_.body;
    nb::list found;
    for (int signal = 0; signal < ANHYST_LOOP_SIGNALS; signal++) {
      const auto which = static_cast<anhyst_plant_signal>(signal);
      const anhyst_plant_signal_row &row = anhyst_plant_signals[signal];
      for (int j = 0; j < anhyst_plant_signal_count(body, which); j++) {
        const bool angle = row.shape == ANHYST_EACH_COORDINATE && body->coordinate[j].axis >= 3;
        found.append(nb::make_tuple(row.name, angle ? row.angular : row.unit, j + 1));
      }
    }
    return found;
  }

  OutTable run(const In &target, const In &load, const In &inject, const In &feed,
               const Commands &command, const std::optional<In> &frame)
  {
    const size_t n = load.shape(0);
    const auto coordinates = static_cast<size_t>(loop_.body->coordinates);
    const auto width =
        static_cast<size_t>(anhyst_plant_signal_column(loop_.body, ANHYST_LOOP_SIGNALS));
    same_length(n * coordinates, target.shape(0), "target");
    same_length(n * coordinates, inject.shape(0), "inject");
    same_length(n * coordinates, feed.shape(0), "feed");
    same_length(n, command.shape(0), "command");
    if (frame) {
      same_length((n + 1) * coordinates, frame->shape(0), "frame");
    }
    std::unique_ptr<double[]> record(new double[n * width]);
    const anhyst_plant_events events = {target.data(),  load.data(),
                                        inject.data(),  feed.data(),
                                        command.data(), frame ? frame->data() : nullptr};
    size_t rows;
    {
      nb::gil_scoped_release release;
      rows = anhyst_plant_loop_run(&loop_, &events, n, record.get());
    }
    return own_table(record.release(), rows, width);
  }

private:
  std::vector<anhyst_plant_current_loop> current_loops_;
  std::vector<double> room_;
  anhyst_plant_loop loop_{};
};

} // namespace

void bind_loop(nb::module_ &m)
{
  nb::class_<Loop>(m, "PlantLoop")
      .def(nb::init<Plant &, LoopController &, const std::vector<nb::dict> &>(), "plant"_a,
           "controller"_a, "current_loops"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
      .def_prop_ro("signals", &Loop::signals)
      .def("run", &Loop::run, "target"_a.noconvert(), "load"_a.noconvert(), "inject"_a.noconvert(),
           "feed"_a.noconvert(), "command"_a.noconvert(), "frame"_a = nb::none());
}
