// SPDX-License-Identifier: Apache-2.0
// Functions for a parameter search: the normalised law with derivatives, and batch simulation.
#include <nanobind/stl/string.h>

#include <memory>
#include <vector>

#include "anhyst/law/batch.h"
#include "anhyst/law/sensitivity.h"
#include "arrays.h"

namespace {

class Operator {
public:
  Operator(double kappa, double c, double play, double eps, const std::string &law,
           const std::string &step)
  {
    law_ = {to_step(law, step), kappa, c, play, eps, nullptr};
    if (law_.step == ANHYST_STEP_EXACT) {
      branch_ = std::make_unique<anhyst_branch_f64>();
      if (anhyst_branch_build_f64(branch_.get(), kappa) == ANHYST_OK) {
        law_.branch = branch_.get();
      }
    }
    if (anhyst_operator_check_f64(&law_) != ANHYST_OK) {
      throw std::invalid_argument(
          "parameters out of range: 0.001 <= kappa <= 1000, 0 <= c <= 1, play >= 0, eps <= 2.85");
    }
  }

  nb::tuple run(const In &omega, const In &r, const In &state) const
  {
    const size_t n = r.shape(0);
    same_length(n, omega.shape(0), "omega");
    Out x = make_array(n);
    Out m = make_array(n);
    anhyst_state_f64 now = to_state(state);
    anhyst_status status = anhyst_state_check_f64(&law_, &now);
    size_t i = 0;
    {
      nb::gil_scoped_release release;
      for (; i < n && status == ANHYST_OK; i++) {
        anhyst_candidate_f64 next;
        status = anhyst_solve_f64(&law_, &now, omega.data()[i], r.data()[i], &next);
        if (status == ANHYST_OK) {
          now = next.state;
          x.data()[i] = now.x;
          m.data()[i] = next.m;
        }
      }
    }
    return nb::make_tuple(x, m, from_state(now), static_cast<int>(status), i);
  }

  nb::tuple sensitivity(const In &omega, const In &r, const InTable &omega_t, const InTable &r_t,
                        const InTable &law_t, const In &state, const InTable &state_t)
  {
    const size_t n = r.shape(0);
    const size_t directions = law_t.shape(0);
    same_length(n, omega.shape(0), "omega");
    same_shape(n, directions, omega_t, "omega_t");
    same_shape(n, directions, r_t, "r_t");
    same_shape(directions, 3, law_t, "law_t");
    same_shape(directions, 3, state_t, "state_t");
    if (law_.step == ANHYST_STEP_EXACT && !branch_slope_) {
      branch_slope_ = std::make_unique<anhyst_branch_slope_f64>();
      anhyst_branch_slope_build_f64(branch_slope_.get(), law_.kappa);
    }
    std::vector<anhyst_tangent_f64> tangents(directions);
    for (size_t j = 0; j < directions; j++) {
      tangents[j] = {
          law_t(j, 0), law_t(j, 1), law_t(j, 2), {state_t(j, 0), state_t(j, 1), state_t(j, 2)}};
    }
    Out x = make_array(n);
    Out m = make_array(n);
    OutTable x_t = make_table(n, directions);
    OutTable m_t = make_table(n, directions);
    OutTable state_after = make_table(directions, 3);
    anhyst_state_f64 now = to_state(state);
    size_t index = 0;
    anhyst_status status = anhyst_state_check_f64(&law_, &now);
    if (status == ANHYST_OK) {
      nb::gil_scoped_release release;
      const anhyst_differentiated_drive_f64 drive = {n,        directions,     omega.data(),
                                                     r.data(), omega_t.data(), r_t.data()};
      status = anhyst_sensitivity_f64(&law_, branch_slope_.get(), &drive, &now, tangents.data(),
                                      x.data(), m.data(), x_t.data(), m_t.data(), &index);
    }
    for (size_t j = 0; j < directions; j++) {
      state_after.data()[3 * j] = tangents[j].state.x;
      state_after.data()[3 * j + 1] = tangents[j].state.y;
      state_after.data()[3 * j + 2] = tangents[j].state.p;
    }
    return nb::make_tuple(x, m, x_t, m_t, from_state(now), state_after, static_cast<int>(status),
                          index);
  }

private:
  std::unique_ptr<anhyst_branch_f64> branch_;
  std::unique_ptr<anhyst_branch_slope_f64> branch_slope_;
  anhyst_operator_f64 law_;
};

// Names of the instruction sets, from the base level to the best one.
const char *const LEVELS[] = {"base", "avx2", "avx512"};

// The best level is determined only once, because this is slow on a virtual machine.
anhyst_batch_level best_level()
{
  static const anhyst_batch_level best = anhyst_batch_best();
  return best;
}

nb::list batch_levels()
{
  nb::list found;
  for (int level = 0; level <= best_level(); level++) {
    found.append(LEVELS[level]);
  }
  return found;
}

anhyst_batch_level to_level(const std::string &name)
{
  for (int level = 0; level <= best_level(); level++) {
    if (name == LEVELS[level]) {
      return static_cast<anhyst_batch_level>(level);
    }
  }
  throw std::invalid_argument("this processor has no level \"" + name + "\" of the batch");
}

nb::object batch(const In &kappa, const In &c, const In &omega, const In &scale, const In &offset,
                 const In &drive, const InOut &x, const InOut &y, bool implicit, bool keep,
                 const std::string &level)
{
  const anhyst_batch_level with = to_level(level);
  const size_t sets = kappa.shape(0);
  const size_t n = drive.shape(0);
  for (const size_t length :
       {c.shape(0), omega.shape(0), scale.shape(0), offset.shape(0), x.shape(0), y.shape(0)}) {
    same_length(sets, length, "a parameter or state of the batch");
  }
  OutTable m_out = make_table(keep ? n : 0, sets);
  OutTable x_out = make_table(keep ? n : 0, sets);
  anhyst_status status;
  {
    nb::gil_scoped_release release;
    const anhyst_batch_sets all = {sets,         kappa.data(), c.data(),
                                   omega.data(), scale.data(), offset.data()};
    status = anhyst_batch_f64(&all, with, implicit ? ANHYST_BATCH_IMPLICIT : ANHYST_BATCH_EXPLICIT,
                              n, drive.data(), x.data(), y.data(), keep ? m_out.data() : nullptr,
                              keep ? x_out.data() : nullptr);
  }
  if (status != ANHYST_OK) {
    throw std::invalid_argument("a set is out of range: kappa > 0, 0 <= c <= 1, omega > -3");
  }
  return nb::make_tuple(m_out, x_out);
}

nb::tuple batch_functions(const In &t, const std::string &level)
{
  const anhyst_batch_level with = to_level(level);
  Out exp_minus = make_array(t.shape(0));
  Out langevin = make_array(t.shape(0));
  anhyst_batch_functions_f64(with, t.shape(0), t.data(), exp_minus.data(), langevin.data());
  return nb::make_tuple(exp_minus, langevin);
}

} // namespace

void bind_identification(nb::module_ &m)
{
  const std::string best = LEVELS[best_level()];
  nb::class_<Operator>(m, "Operator")
      .def(nb::init<double, double, double, double, const std::string &, const std::string &>(),
           "kappa"_a, "c"_a, "play"_a = 0.0, "eps"_a = 0.0, "law"_a = "effective-field",
           "step"_a = "exact")
      .def("run", &Operator::run, "omega"_a.noconvert(), "r"_a.noconvert(), "state"_a.noconvert())
      .def("sensitivity", &Operator::sensitivity, "omega"_a.noconvert(), "r"_a.noconvert(),
           "omega_t"_a.noconvert(), "r_t"_a.noconvert(), "law_t"_a.noconvert(),
           "state"_a.noconvert(), "state_t"_a.noconvert());
  m.def("batch", &batch, "kappa"_a.noconvert(), "c"_a.noconvert(), "omega"_a.noconvert(),
        "scale"_a.noconvert(), "offset"_a.noconvert(), "drive"_a.noconvert(), "x"_a.noconvert(),
        "y"_a.noconvert(), "implicit"_a = true, "keep"_a = true, "level"_a = best);
  m.def("batch_functions", &batch_functions, "t"_a.noconvert(), "level"_a = best);
  m.def("batch_levels", &batch_levels);
}
