// SPDX-License-Identifier: Apache-2.0
// Play cells for a fit: the equation alone, with derivatives.
#include <nanobind/stl/string.h>

#include <vector>

#include "anhyst/law/cell_sensitivity.h"
#include "cells.h"

namespace {

class CellOperator {
public:
  CellOperator(const In &thresholds, const In &widths, const InTable &weights,
               const std::string &shape)
      : cells_(thresholds, widths, weights, shape)
  {
  }

  nb::tuple run(const In &omega, const In &r, const In &state) const
  {
    const size_t n = r.shape(0);
    same_length(n, omega.shape(0), "omega");
    Out x = make_array(n);
    Out m = make_array(n);
    anhyst_cells_state_f64 now = enter(state);
    anhyst_status status = ANHYST_OK;
    size_t i = 0;
    {
      nb::gil_scoped_release release;
      for (; i < n && status == ANHYST_OK; i++) {
        anhyst_cells_candidate_f64 next;
        status = anhyst_cells_solve_f64(cells_.get(), &now, omega.data()[i], r.data()[i], &next);
        if (status == ANHYST_OK) {
          anhyst_cells_accept_f64(cells_.get(), &now, &next);
          x.data()[i] = now.x;
          m.data()[i] = now.m;
        }
      }
    }
    return nb::make_tuple(x, m, leave(now), static_cast<int>(status), i);
  }

  nb::tuple sensitivity(const In &omega, const In &r, const InTable &omega_t, const InTable &r_t,
                        const InCube &weights_t, const InTable &widths_t, const InTable &thresholds_t,
                        const In &state, const InTable &state_t) const
  {
    const size_t n = r.shape(0);
    const size_t directions = state_t.shape(0);
    const auto cells = static_cast<size_t>(cells_.weights()->cells);
    const auto widths = static_cast<size_t>(cells_.weights()->widths);
    same_length(n, omega.shape(0), "omega");
    same_shape(n, directions, omega_t, "omega_t");
    same_shape(n, directions, r_t, "r_t");
    same_length(cells, weights_t.shape(0), "weights_t");
    same_length(widths, weights_t.shape(1), "weights_t");
    same_length(directions, weights_t.shape(2), "weights_t");
    same_shape(widths, directions, widths_t, "widths_t");
    same_shape(cells, directions, thresholds_t, "thresholds_t");
    same_shape(directions, cells, state_t, "state_t");
    Out x = make_array(n);
    Out m = make_array(n);
    OutTable x_t = make_table(n, directions);
    OutTable m_t = make_table(n, directions);
    OutTable after = make_table(directions, cells);
    std::vector<double> rest(directions);
    std::copy(state_t.data(), state_t.data() + state_t.size(), after.data());
    anhyst_cells_state_f64 now = enter(state);
    size_t index = 0;
    anhyst_status status;
    {
      nb::gil_scoped_release release;
      const anhyst_differentiated_drive_f64 drive = {n,        directions,     omega.data(),
                                                     r.data(), omega_t.data(), r_t.data()};
      const anhyst_cell_directions_f64 by = {weights_t.data(), widths_t.data(),
                                             thresholds_t.data()};
      status = anhyst_cells_sensitivity_f64(cells_.get(), cells_.weights(), &by, &drive, &now,
                                            after.data(), rest.data(), x.data(), m.data(),
                                            x_t.data(), m_t.data(), &index);
    }
    return nb::make_tuple(x, m, x_t, m_t, leave(now), after, static_cast<int>(status), index);
  }

  double steepest() const { return cells_.get()->steepest; }

private:
  anhyst_cells_state_f64 enter(const In &state) const
  {
    same_length(static_cast<size_t>(cells_.get()->cells), state.shape(0), "the state");
    anhyst_cells_state_f64 now{};
    anhyst_cells_enter_f64(cells_.get(), state.data(), &now);
    return now;
  }

  Out leave(const anhyst_cells_state_f64 &now) const
  {
    Out numbers = make_array(static_cast<size_t>(cells_.get()->cells));
    anhyst_cells_numbers_f64(cells_.get(), &now, numbers.data());
    return numbers;
  }

  Cells cells_;
};

} // namespace

void bind_cells(nb::module_ &m)
{
  nb::class_<CellOperator>(m, "CellOperator")
      .def(nb::init<const In &, const In &, const InTable &, const std::string &>(),
           "thresholds"_a.noconvert(), "widths"_a.noconvert(), "weights"_a.noconvert(),
           "shape"_a = "tanh")
      .def_prop_ro("steepest", &CellOperator::steepest)
      .def("run", &CellOperator::run, "omega"_a.noconvert(), "r"_a.noconvert(),
           "state"_a.noconvert())
      .def("sensitivity", &CellOperator::sensitivity, "omega"_a.noconvert(), "r"_a.noconvert(),
           "omega_t"_a.noconvert(), "r_t"_a.noconvert(), "weights_t"_a.noconvert(),
           "widths_t"_a.noconvert(), "thresholds_t"_a.noconvert(), "state"_a.noconvert(),
           "state_t"_a.noconvert());
}
