// SPDX-License-Identifier: Apache-2.0
// The PIDD2 controller in Python, in each format, with the C functions of a real controller.
#include "gains.h"

namespace {

template <class Format> class Controller {
public:
  using number = typename Format::number;

  explicit Controller(const typename Format::row &gains) : gains_(valid_gains<Format>(gains)) {}

  void start(number reference, number position, number load, number output)
  {
    Format::start(&gains_, &state_, reference, position, load, output);
  }

  number solve(number reference, number position, number load)
  {
    return Format::solve(&gains_, &state_, reference, position, load, &candidate_);
  }

  void commit(number applied) { Format::commit(&gains_, &state_, &candidate_, applied); }

  void set_gains(const typename Format::row &gains, number reference, number position, number load)
  {
    const typename Format::gains to = valid_gains<Format>(gains);
    Format::change(&gains_, &to, &state_, reference, position, load);
    gains_ = to;
  }

  number wanted() const { return candidate_.unlimited_output; }

  nb::tuple state() const
  {
    return nb::make_tuple(state_.position, state_.velocity, state_.integral);
  }

private:
  typename Format::gains gains_;
  typename Format::state state_{};
  typename Format::candidate candidate_{};
};

template <class Format> void bind(nb::module_ &m, const char *name)
{
  using Bound = Controller<Format>;
  nb::class_<Bound>(m, name)
      .def(nb::init<const typename Format::row &>(), "gains"_a.noconvert())
      .def("start", &Bound::start, "reference"_a, "position"_a, "load"_a, "output"_a)
      .def("solve", &Bound::solve, "reference"_a, "position"_a, "load"_a)
      .def("commit", &Bound::commit, "applied"_a)
      .def("change", &Bound::set_gains, "gains"_a.noconvert(), "reference"_a, "position"_a,
           "load"_a)
      .def_prop_ro("wanted", &Bound::wanted)
      .def_prop_ro("state", &Bound::state);
}

} // namespace

void bind_control(nb::module_ &m)
{
  bind<GainsQ31>(m, "FixedController");
  bind<GainsF64>(m, "Controller");
  bind<GainsF32>(m, "ControllerF32");
}
