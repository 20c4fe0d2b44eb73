// SPDX-License-Identifier: Apache-2.0
// The Python module: it converts and checks arguments, and contains no other logic.
#include <nanobind/stl/string.h>

#include <memory>

#include "anhyst/numeric/elementary.h"
#include "anhyst/law/langevin.h"
#include "iron.h"

anhyst_step to_step(const std::string &law, const std::string &step)
{
  if (law == "jiles-atherton-1986") {
    return ANHYST_STEP_JA1986;
  }
  if (law == "effective-field" && step == "exact") {
    return ANHYST_STEP_EXACT;
  }
  if (law == "effective-field" && step == "linear") {
    return ANHYST_STEP_LINEAR;
  }
  throw std::invalid_argument("unknown law or step: " + law + ", " + step);
}

namespace {

const char *status_text(int status)
{
  switch (status) {
  case ANHYST_OK:
    return "ok";
  case ANHYST_BAD_PARAMETER:
    return "a parameter is outside its range";
  case ANHYST_BAD_STATE:
    return "the law cannot reach this initial state";
  case ANHYST_REFUSED:
    return "even the reversible part would jump; alpha times its largest slope, c*M_s/(3a) or "
           "M_0/a_0, must stay below 1";
  case ANHYST_OUT_OF_RANGE:
    return "the effective field leaves the range of the law's tables";
  case ANHYST_NOT_CONVERGED:
    return "the equation of the law did not converge";
  case ANHYST_NOT_SETTLED:
    return "the cycle did not close within the given repetitions";
  default:
    return "unknown status";
  }
}

Out apply_to_each(double (*function)(double), const In &x)
{
  const size_t n = x.shape(0);
  Out value = make_array(n);
  for (size_t i = 0; i < n; i++) {
    value.data()[i] = function(x(i));
  }
  return value;
}

} // namespace

NB_MODULE(_native, m)
{
  // Caches of the package keep irons until the process ends. This is not a leak.
  nb::set_leak_warnings(false);
  m.doc() = "The anhyst C core.";
  nb::class_<AnyIron>(m, "AnyIron")
      .def(
          "forward",
          [](const AnyIron &self, const In &drive, const In &rho, const In &eddy, const In &state) {
            return self.record(0, drive, rho, eddy, state);
          },
          "drive"_a.noconvert(), "rho"_a.noconvert(), "eddy"_a.noconvert(), "state"_a.noconvert())
      .def(
          "inverse",
          [](const AnyIron &self, const In &b, const In &rho, const In &eddy, const In &state) {
            return self.record(1, b, rho, eddy, state);
          },
          "b"_a.noconvert(), "rho"_a.noconvert(), "eddy"_a.noconvert(), "state"_a.noconvert())
      .def("settle", &AnyIron::settle, "given"_a.noconvert(), "rho"_a.noconvert(),
           "eddy"_a.noconvert(), "state"_a.noconvert(), "inverse"_a = false, "max_cycles"_a = 10000,
           "tol"_a = 1e-12)
      .def("make_solid", &AnyIron::make_solid, "layers"_a, "surface"_a, "laminated"_a)
      .def("set_eddy_circuit", &AnyIron::set_eddy_circuit, "leaky"_a, "leaky_delay"_a, "excess"_a)
      .def("check_state", &AnyIron::check_state, "state"_a.noconvert())
      .def("flux_of", &AnyIron::flux_of, "state"_a.noconvert());
  nb::class_<LagIron, AnyIron>(m, "Iron").def(
      nb::init<double, double, double, double, double, double, const std::string &,
               const std::string &>(),
      "m_s"_a, "a"_a, "k"_a, "c"_a, "alpha"_a, "r_d"_a = 0.0, "law"_a = "effective-field",
      "step"_a = "exact");
  nb::class_<CellIron, AnyIron>(m, "CellIron")
      .def(nb::init<const In &, const In &, const InTable &, const std::string &, double,
                    const std::optional<In> &>(),
           "thresholds"_a.noconvert(), "widths"_a.noconvert(), "weights"_a.noconvert(),
           "shape"_a = "tanh", "alpha"_a = 0.0, "centres"_a.noconvert() = nb::none())
      .def_prop_ro("steepest", &CellIron::steepest);
  m.def("demagnetised", [] { return from_state({0.0, 0.0, 0.0}); });
  m.def("status_text", &status_text, "status"_a);
  m.def("exp", [](const In &x) { return apply_to_each(anhyst_exp_f64, x); }, "x"_a.noconvert());
  m.def("log", [](const In &x) { return apply_to_each(anhyst_log_f64, x); }, "x"_a.noconvert());
  m.def(
      "langevin",
      [](const In &z) {
        const size_t n = z.shape(0);
        Out value = make_array(n);
        Out slope = make_array(n);
        for (size_t i = 0; i < n; i++) {
          value.data()[i] = anhyst_langevin_f64(z(i), &slope.data()[i]);
        }
        return nb::make_tuple(value, slope);
      },
      "z"_a.noconvert());
  bind_identification(m);
  bind_cells(m);
  bind_compensator(m);
  bind_control(m);
  bind_supervisor(m);
  bind_force_controllers(m);
  bind_plant(m);
  bind_position(m);
  bind_bus(m);
  bind_loop(m);
  bind_tracking(m);
  bind_axes_fixed(m);
  bind_piezo(m);
}
