// SPDX-License-Identifier: Apache-2.0
// The controllers of a body that follows a set-point, in floating point.
// They run the same C functions as a real controller.
#include "tracking.h"

#include <algorithm>
#include <limits>

#include <nanobind/stl/vector.h>

#include "anhyst/control/states.h"
#include "position.h"

namespace {

// Directions in which the magnets pull, row by row.
class Layout {
public:
  Layout(const InTable &pull, const std::vector<uint16_t> &against, uint16_t kind, double idle,
         double least, double most, const std::vector<double> &yields)
      : pull_(pull.data(), pull.data() + pull.size()),
        against_(against),
        yields_(yields)
  {
    same_length(pull.shape(0), against.size(), "against");
    same_length(pull.shape(1), yields.size(), "yields");
    layout_ = {static_cast<uint16_t>(pull.shape(1)),
               static_cast<uint16_t>(pull.shape(0)),
               pull_.data(),
               against_.data(),
               {idle, kind},
               least,
               most,
               yields_.data()};
    if (pull.shape(0) > ANHYST_WRENCH_DRIVES ||
        anhyst_wrench_init_f64(&wrench_, &layout_) != ANHYST_OK) {
      throw std::invalid_argument("these drives cannot push along every axis");
    }
  }
  Layout(const Layout &) = delete;
  Layout &operator=(const Layout &) = delete;

  void lose(int drive) { anhyst_wrench_lose_f64(&wrench_, drive); }
  // Returns the forces, and whether they produce the wrench.
  nb::tuple share(const std::vector<double> &wrench)
  {
    same_length(wrench.size(), layout_.axes, "wrench");
    std::vector<double> force(layout_.drives);
    const bool made = anhyst_wrench_share_f64(&wrench_, wrench.data(), force.data()) != 0;
    return nb::make_tuple(force, made);
  }
  const anhyst_wrench_layout_f64 &get() const { return layout_; }

private:
  std::vector<double> pull_;
  std::vector<uint16_t> against_;
  std::vector<double> yields_;
  anhyst_wrench_layout_f64 layout_{};
  anhyst_wrench_f64 wrench_{};
};

template <class F> class TrackingAxes : public LoopController {
  using Real = typename F::Real;
  using Row = std::vector<Real>;

public:
  TrackingAxes(const nb::list &magnets, const Layout &layout, const nb::dict &rows,
               const nb::dict &settings)
  {
    const auto &wide = layout.get();
    const size_t axes = wide.axes;
    Settings matrices(rows);
    const InTable at = matrices.take<InTable>("at");
    const size_t heads = at.shape(0);
    same_shape(heads, axes, at, "at");
    at_.assign(at.data(), at.data() + at.size());
    const auto row = [&](const char *name, size_t count, size_t columns) -> const Real * {
      const InTable table = matrices.take<InTable>(name);
      same_shape(count, columns, table, name);
      return rows_.emplace_back(table.data(), table.data() + table.size()).data();
    };
    const auto narrow = [&](const double *values, size_t count) -> const Real * {
      return rows_.emplace_back(values, values + count).data();
    };
    const Real *pid = row("pid", axes, 5);
    for (const Real *p = pid; p != pid + 5 * axes; p += 5) {
      pid_.push_back({{p[0], p[1], p[2]}, {p[3], p[4]}});
    }
    Settings given(settings);
    drives_.add_magnets(magnets, read_scales(given));
    same_length(drives_.size(), wide.drives, "magnets");
    current_.resize(wide.drives);
    demand_.resize(axes);
    settings_ = {{wide.axes,
                  wide.drives,
                  narrow(wide.pull, axes * wide.drives),
                  wide.against,
                  {static_cast<Real>(wide.pair.idle), wide.pair.kind},
                  static_cast<Real>(wide.least),
                  static_cast<Real>(wide.most),
                  narrow(wide.yields, axes)},
                 static_cast<uint16_t>(heads),
                 row("see", axes, heads),
                 row("decouple", axes, axes),
                 row("weigh", axes, axes),
                 pid_.data(),
                 row("reach", axes, 1),
                 given.take<Real>("current_low"),
                 given.take<Real>("current_high"),
                 given.take<Real>("current_step"),
                 given.take<Real>("follow"),
                 given.take<Real>("slew"),
                 given.take<Real>("off"),
                 given.take<uint16_t>("off_ticks"),
                 given.take<uint16_t>("spare"),
                 given.take<uint16_t>("land_ticks"),
                 row("land", axes, 1),
                 row("lift", axes, 1),
                 row("without", heads * axes, heads),
                 given.take<uint16_t>("spare_heads"),
                 given.take<Real>("jump"),
                 given.take<uint16_t>("doubt"),
                 given.take<uint16_t>("noisy"),
                 nullptr};
    for (double one : matrices.take<std::vector<double>>("ground")) {
      axis_.push_back(static_cast<uint16_t>(one));
    }
    if (!axis_.empty()) {
      same_length(axes, axis_.size(), "ground");
      settings_.axis = axis_.data();
    }
    matrices.finish();
    given.finish();
    if (F::init(&axes_, &settings_, drives_.data()) != ANHYST_OK) {
      throw std::invalid_argument("the settings of the controller are not valid");
    }
  }

  void correct(const InTable &rows) { drives_.apply_correction(rows); }
  anhyst_loop_controller handle() override { return {this, loop_tick}; }

  // Runs one tick without a plant; head positions are relative to the target.
  // Returns currents, wrench, flags, lost drives and state.
  nb::tuple tick(const Row &head, const Row &forward, const Row &gap, const Row &read,
                 uint16_t command, const Row &target)
  {
    same_length(axis_.size(), target.size(), "target");
    same_length(settings_.heads, head.size(), "head");
    same_length(settings_.layout.axes, forward.size(), "forward");
    same_length(drives_.size(), gap.size(), "gap");
    same_length(drives_.size(), read.size(), "read");
    const Row flux(gap.size(), std::numeric_limits<Real>::quiet_NaN());
    const auto out = run(head, forward, gap, flux, read, command, target);
    return nb::make_tuple(current_, demand_, out.flags, out.lost, out.state);
  }

private:
  typename F::Answer run(const Row &head, const Row &forward, const Row &gap, const Row &flux,
                         const Row &read, uint16_t command, const Row &target)
  {
    const typename F::Sample in = {head.data(), forward.data(), gap.data(),   flux.data(),
                                   read.data(), command,        target.data()};
    typename F::Answer out = {current_.data(), demand_.data(), 0, 0, 0};
    F::tick(&axes_, &in, &out);
    return out;
  }

  // Runs one tick of a simulated loop; the load of its sample is the wrench that is fed forward.
  // The heads are the gap sensors, one per magnet, followed by the position heads.
  static void loop_tick(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer)
  {
    auto &c = *static_cast<TrackingAxes *>(self);
    const size_t axes = c.demand_.size();
    const size_t drives = c.current_.size();
    std::vector<double> head(sample->head + drives, sample->head + drives + c.settings_.heads);
    for (size_t i = 0; i < head.size() * axes; i++) {
      head[i / axes] -= c.at_[i] * sample->target[i % axes];
    }
    const double *gap = sample->head;
    const auto out =
        c.run(Row(head.begin(), head.end()), Row(sample->load, sample->load + axes),
              Row(gap, gap + drives), Row(sample->flux, sample->flux + drives),
              Row(sample->current, sample->current + drives),
              static_cast<uint16_t>(sample->command), Row(sample->target, sample->target + axes));
    answer->flags = out.flags;
    answer->state = anhyst_axes_state_word(out.state, out.lost);
    std::copy(c.current_.begin(), c.current_.end(), answer->current);
    std::copy(c.demand_.begin(), c.demand_.end(), answer->demand);
    std::copy(sample->target, sample->target + axes, answer->reference);
  }

  Drives<F> drives_;
  std::vector<double> at_;
  std::vector<uint16_t> axis_; // axis of each coordinate if the heads are on the ground; else empty
  std::deque<Row> rows_;       // storage of the rows to which the settings point
  Row current_;
  Row demand_;
  std::vector<typename F::Filter> pid_;
  typename F::Settings settings_{};
  typename F::State axes_{};
};

template <class F> void bind_axes(nb::module_ &m, const char *name)
{
  using Axes = TrackingAxes<F>;
  nb::class_<Axes, LoopController>(m, name)
      .def(nb::init<const nb::list &, const Layout &, const nb::dict &, const nb::dict &>(),
           "magnets"_a, "layout"_a, "rows"_a, "settings"_a, nb::keep_alive<1, 3>())
      .def("tick", &Axes::tick, "head"_a, "forward"_a, "gap"_a, "read"_a, "command"_a = 0,
           "target"_a = std::vector<typename F::Real>())
      .def("correct", &Axes::correct, "rows"_a.noconvert());
}

} // namespace

void bind_tracking(nb::module_ &m)
{
  nb::class_<Layout>(m, "WrenchLayout")
      .def(nb::init<const InTable &, const std::vector<uint16_t> &, uint16_t, double, double,
                    double, const std::vector<double> &>(),
           "pull"_a.noconvert(), "against"_a, "kind"_a, "idle"_a, "least"_a, "most"_a, "yields"_a)
      .def("lose", &Layout::lose, "drive"_a)
      .def("share", &Layout::share, "wrench"_a);
  bind_axes<AxesF64>(m, "TrackingAxes");
  bind_axes<AxesF32>(m, "TrackingAxesF32");
  m.attr("AXES_ODD") = ANHYST_AXES_ODD;
}
