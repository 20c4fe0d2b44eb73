// SPDX-License-Identifier: Apache-2.0
// The floating-point compensator in Python: the very functions that run on a controller.
#include <nanobind/stl/string.h>

#include "arrays.h"
#include "real_parameters.h"

namespace {

template <class F> class RealCompensator {
public:
  using Real = typename F::Real;

  explicit RealCompensator(const Owned<F> &parameters) { F::init(&state_, parameters.get()); }
  RealCompensator(const RealCompensator &) = delete;
  RealCompensator &operator=(const RealCompensator &) = delete;

  Real solve(double demand, double gap)
  {
    return F::solve(&state_, static_cast<Real>(demand), static_cast<Real>(gap));
  }
  void commit(double applied, double gap)
  {
    F::commit(&state_, static_cast<Real>(applied), static_cast<Real>(gap));
  }
  Real output() const { return F::output(&state_); }
  int flags() const { return state_.flags; }
  void swap(const Owned<F> &parameters)
  {
    if (parameters.get()->kernel != state_.parameters->kernel) {
      throw std::invalid_argument("the parameters are of another kind");
    }
    F::swap(&state_, parameters.get());
  }

  // Of every memory of the law five numbers and, with plays, where these rest; the surface first.
  Out memory() const
  {
    Out out = make_array(memories() * stride());
    double *to = out.data();
    for (size_t i = 0; i < memories(); i++, to += stride()) {
      const typename F::Memory &now = i == 0 ? state_.memory : state_.deeper[i - 1].memory;
      const Real *plays = i == 0 ? state_.plays : state_.deeper[i - 1].plays;
      Real values[5];
      std::copy(std::begin(now.number), std::end(now.number), values);
      values[3] = stride() > 5U ? static_cast<Real>(now.cells.risen) : values[3];
      values[4] = stride() > 5U ? 0 : values[4];
      std::copy(plays, plays + stride() - 5, std::copy(std::begin(values), std::end(values), to));
    }
    return out;
  }
  void set_memory(const In &values)
  {
    same_length(memories() * stride(), values.shape(0), "memory");
    const auto real = [&](size_t i) { return static_cast<Real>(values(i)); };
    for (size_t i = 0; i < memories(); i++) {
      const size_t at = i * stride();
      if (!(is_level(values(at + 1)) && is_level(values(at + 4)))) {
        throw std::invalid_argument("a level lies within -1..1");
      }
    }
    for (size_t i = 0; i < memories(); i++) {
      const size_t at = i * stride();
      Real *plays = i == 0 ? state_.plays : state_.deeper[i - 1].plays;
      typename F::Memory &now = i == 0 ? state_.memory : state_.deeper[i - 1].memory;
      now = {{real(at), real(at + 1), real(at + 2), real(at + 3), real(at + 4)}};
      if (stride() > 5U) {
        const double bits = values(at + 3); // of plays; those beyond them say nothing
        now.cells.risen = bits > 0.0 ? static_cast<uint32_t>(std::min(bits, 1e9)) : 0U;
      }
      for (size_t play = 0; play < stride() - 5; play++) {
        plays[play] = real(at + 5 + play);
      }
    }
    state_.solved = 0;
  }

  // A whole record: at every sample solve, and commit the solved current.
  Out run(const In &demand, const In &gap)
  {
    same_length(demand.shape(0), gap.shape(0), "gap");
    Out out = make_array(demand.shape(0));
    nb::gil_scoped_release release;
    for (size_t i = 0; i < demand.shape(0); i++) {
      const Real at = static_cast<Real>(gap(i));
      const Real current = F::solve(&state_, static_cast<Real>(demand(i)), at);
      F::commit(&state_, current, at);
      out.data()[i] = current;
    }
    return out;
  }

  int32_t conditioning_length() const { return F::conditioning_length(&state_); }
  Real conditioning(int32_t tick) const { return F::conditioning(&state_, tick); }

private:
  size_t memories() const
  {
    const auto *solid = state_.parameters->solid;
    return solid == nullptr ? 1U : solid->layers + (solid->laminated > 0 ? 1U : 0U);
  }
  size_t stride() const
  {
    return state_.parameters->kernel->keep != nullptr ? 5U + ANHYST_CELLS : 5U;
  }

  static bool is_level(double value) { return value >= -1.0 && value <= 1.0; }

  typename F::Compensator state_{};
};

template <class F> void bind(nb::module_ &m, const char *parameters, const char *compensator)
{
  using Parameters = Owned<F>;
  using Compensator = RealCompensator<F>;
  nb::class_<Parameters>(m, parameters)
      .def(nb::init<const std::string &, const nb::dict &, const InRows &, const nb::dict &>(),
           "kind"_a, "numbers"_a, "gaps"_a.noconvert(), "tables"_a);
  nb::class_<Compensator>(m, compensator)
      .def(nb::init<const Parameters &>(), "parameters"_a, nb::keep_alive<1, 2>())
      .def("solve", &Compensator::solve, "demand"_a, "gap"_a)
      .def("commit", &Compensator::commit, "applied"_a, "gap"_a)
      .def("output", &Compensator::output)
      .def_prop_ro("flags", &Compensator::flags)
      .def("swap", &Compensator::swap, "parameters"_a, nb::keep_alive<1, 2>())
      .def_prop_ro("memory", &Compensator::memory, nb::rv_policy::move)
      .def("set_memory", &Compensator::set_memory, "values"_a.noconvert())
      .def("run", &Compensator::run, "demand"_a.noconvert(), "gap"_a.noconvert())
      .def("conditioning_length", &Compensator::conditioning_length)
      .def("conditioning", &Compensator::conditioning, "tick"_a);
}

} // namespace

void bind_real_compensator(nb::module_ &m)
{
  bind<F64>(m, "Parameters", "Compensator");
  bind<F32>(m, "ParametersF32", "CompensatorF32");
}
