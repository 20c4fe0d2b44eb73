// SPDX-License-Identifier: Apache-2.0
// The controllers of what follows a set-point, a mass between two magnets in every format and a
// body of several axes: the very functions that run on a controller.
#include "tracking.h"

#include <nanobind/stl/vector.h>

#include "anhyst_plant/tracking_axes.h"
#include "position.h"

namespace {

template <class F> class Tracking : public LoopController {
public:
  Tracking(const nb::list &magnets, const typename F::Row &pid, const nb::dict &settings)
  {
    Settings given(settings);
    adapter_.scales = take_scales(given);
    adapter_.gap_total = given.take<double>("gap_total");
    if (magnets.empty() || magnets.size() > ANHYST_TRACKING_MOST_DRIVES) {
      throw std::invalid_argument("a controller has 1 to 16 magnets");
    }
    law_.start(magnets, nb::list(), F::pid(pid), given, adapter_.scales);
    given.finish();
    adapter_.tracking = law_.get();
  }

  void correct(const InTable &rows) { law_.correct(rows); }
  anhyst_loop_controller handle() override { return {&adapter_, F::tick}; }

private:
  TrackingLaw<F> law_;
  typename F::Adapter adapter_{};
};

template <class F> nb::class_<Tracking<F>, LoopController> bind(nb::module_ &m, const char *name)
{
  return nb::class_<Tracking<F>, LoopController>(m, name).def(
      nb::init<const nb::list &, const typename F::Row &, const nb::dict &>(), "magnets"_a,
      "pid"_a.noconvert(), "settings"_a);
}

// Numbers of a controller of several axes, row by row.
class Layout {
public:
  Layout(const InTable &pull, const std::vector<uint16_t> &against, uint16_t kind, double idle,
         double least)
      : pull_(pull.data(), pull.data() + pull.size()),
        against_(against)
  {
    same_length(pull.shape(0), against.size(), "against");
    layout_ = {static_cast<uint16_t>(pull.shape(1)),
               static_cast<uint16_t>(pull.shape(0)),
               pull_.data(),
               against_.data(),
               {idle, kind},
               least};
    if (pull.shape(0) > ANHYST_WRENCH_DRIVES || anhyst_wrench_check(&layout_) != ANHYST_OK) {
      throw std::invalid_argument("these drives cannot push along every axis");
    }
  }
  Layout(const Layout &) = delete;
  Layout &operator=(const Layout &) = delete;

  // Forces, and whether they make the wrench.
  nb::tuple share(const std::vector<double> &wrench) const
  {
    same_length(wrench.size(), layout_.axes, "wrench");
    std::vector<double> force(layout_.drives);
    const bool made = anhyst_wrench_share(&layout_, wrench.data(), force.data()) != 0;
    return nb::make_tuple(force, made);
  }
  const anhyst_wrench_layout &get() const { return layout_; }

private:
  std::vector<double> pull_;
  std::vector<uint16_t> against_;
  anhyst_wrench_layout layout_{};
};

class TrackingAxes : public LoopController {
public:
  TrackingAxes(const nb::list &magnets, const Layout &layout, const nb::dict &rows,
               const nb::dict &settings)
  {
    Settings matrices(rows);
    const size_t axes = layout.get().axes;
    size_t heads = 0;
    see_ = copy(matrices, "see", axes, &heads);
    decouple_ = copy(matrices, "decouple", axes, nullptr);
    weigh_ = copy(matrices, "weigh", axes, nullptr);
    const InTable pid = matrices.take<InTable>("pid");
    matrices.finish();
    same_length(axes, pid.shape(0), "pid");
    same_length(5, pid.shape(1), "a filter");
    for (size_t i = 0; i < axes; i++) {
      pid_.push_back({{pid(i, 0), pid(i, 1), pid(i, 2)}, {pid(i, 3), pid(i, 4)}});
    }
    Settings given(settings);
    drives_.start(magnets, take_scales(given));
    same_length(drives_.size(), layout.get().drives, "magnets");
    settings_ = {layout.get(),
                 static_cast<uint16_t>(heads),
                 see_.data(),
                 decouple_.data(),
                 weigh_.data(),
                 pid_.data(),
                 given.take<double>("current_low"),
                 given.take<double>("current_high"),
                 given.take<double>("current_step")};
    given.finish();
    if (anhyst_axes_init(&axes_, &settings_, drives_.data()) != ANHYST_OK) {
      throw std::invalid_argument("the settings of the controller are not valid");
    }
  }

  void correct(const InTable &rows) { drives_.correct(rows); }
  anhyst_loop_controller handle() override { return {&axes_, anhyst_tracking_axes_tick}; }

private:
  // Of so many rows; square where the columns are not asked for.
  static std::vector<double> copy(Settings &given, const char *name, size_t rows, size_t *columns)
  {
    const InTable table = given.take<InTable>(name);
    same_length(rows, table.shape(0), name);
    if (columns) {
      *columns = table.shape(1);
    } else {
      same_length(rows, table.shape(1), name);
    }
    return {table.data(), table.data() + table.size()};
  }

  Drives<TrackingF64> drives_;
  std::vector<double> see_;
  std::vector<double> decouple_;
  std::vector<double> weigh_;
  std::vector<anhyst_biquad_f64> pid_;
  anhyst_axes_settings settings_{};
  anhyst_axes axes_{};
};

nb::tuple allocate(double net, double idle)
{
  const anhyst_allocation_f64 allocation = {idle, ANHYST_ALLOCATE_CLASS_AB};
  double force[2];
  anhyst_allocate_f64(&allocation, net, force);
  return nb::make_tuple(force[0], force[1]);
}

} // namespace

void bind_tracking(nb::module_ &m)
{
  bind<TrackingF64>(m, "Tracking")
      .def("correct", &Tracking<TrackingF64>::correct, "rows"_a.noconvert());
  bind<TrackingF32>(m, "TrackingF32")
      .def("correct", &Tracking<TrackingF32>::correct, "rows"_a.noconvert());
  bind<TrackingQ31>(m, "FixedTracking");
  nb::class_<Layout>(m, "WrenchLayout")
      .def(nb::init<const InTable &, const std::vector<uint16_t> &, uint16_t, double, double>(),
           "pull"_a.noconvert(), "against"_a, "kind"_a, "idle"_a, "least"_a)
      .def("share", &Layout::share, "wrench"_a);
  nb::class_<TrackingAxes, LoopController>(m, "TrackingAxes")
      .def(nb::init<const nb::list &, const Layout &, const nb::dict &, const nb::dict &>(),
           "magnets"_a, "layout"_a, "rows"_a, "settings"_a, nb::keep_alive<1, 3>())
      .def("correct", &TrackingAxes::correct, "rows"_a.noconvert());
  m.def("allocate", allocate, "net"_a, "idle"_a);
}
