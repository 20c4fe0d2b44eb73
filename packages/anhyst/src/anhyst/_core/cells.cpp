// SPDX-License-Identifier: Apache-2.0
// The equation of play cells for a fit, with derivatives.
#include <nanobind/stl/string.h>

#include <algorithm>
#include <vector>

#include "anhyst/law/cell_sensitivity.h"
#include "cells.h"

namespace {

using Places = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

class CellOperator {
public:
  CellOperator(const In &thresholds, const In &widths, const InTable &weights,
               const std::string &shape, double aim, const std::optional<In> &centres)
      : cells_(thresholds, widths, weights, shape, centres, aim)
  {
  }

  nb::tuple run(const In &omega, const In &r, const Places &begins) const
  {
    const size_t n = r.shape(0);
    same_length(n, omega.shape(0), "omega");
    const std::vector<size_t> ends = ends_of(begins, n);
    Out x = make_array(n);
    Out m = make_array(n);
    anhyst_status status = ANHYST_OK;
    {
      nb::gil_scoped_release release;
      size_t i = 0;
      for (size_t end : ends) {
        anhyst_cells_state_f64 now = demagnetised();
        for (; i < end && status == ANHYST_OK; i++) {
          anhyst_cells_candidate_f64 next;
          status = anhyst_cells_solve_f64(cells_.get(), &now, omega.data()[i], r.data()[i], &next);
          if (status == ANHYST_OK) {
            anhyst_cells_accept_f64(cells_.get(), &now, &next);
            x.data()[i] = now.x;
            m.data()[i] = now.m;
          }
        }
      }
    }
    return nb::make_tuple(x, m, static_cast<int>(status));
  }

  nb::tuple sensitivity(const In &omega, const In &r, const InTable &omega_t, const InTable &r_t,
                        const InCube &weights_t, const InTable &widths_t,
                        const InTable &thresholds_t, const Places &begins) const
  {
    const size_t n = r.shape(0);
    const size_t directions = omega_t.shape(1);
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
    const std::vector<size_t> ends = ends_of(begins, n);
    Out x = make_array(n);
    Out m = make_array(n);
    OutTable x_t = make_table(n, directions);
    OutTable m_t = make_table(n, directions);
    const anhyst_cell_directions_f64 by = {weights_t.data(), widths_t.data(), thresholds_t.data()};
    anhyst_status status = ANHYST_OK;
    {
      nb::gil_scoped_release release;
      std::vector<double> rest(directions);
      std::vector<double> places_t(directions * cells);
      size_t i = 0;
      for (size_t end : ends) {
        anhyst_cells_state_f64 now = demagnetised();
        std::fill(places_t.begin(), places_t.end(), 0.0);
        const size_t row = i * directions;
        const anhyst_differentiated_drive_f64 drive = {
            end - i,      directions,           omega.data() + i,
            r.data() + i, omega_t.data() + row, r_t.data() + row};
        size_t index = 0;
        if (status == ANHYST_OK) {
          status = anhyst_cells_sensitivity_f64(
              cells_.get(), cells_.weights(), &by, &drive, &now, places_t.data(), rest.data(),
              x.data() + i, m.data() + i, x_t.data() + row, m_t.data() + row, &index);
        }
        i = end;
      }
    }
    return nb::make_tuple(x, m, x_t, m_t, static_cast<int>(status));
  }

  double steepest() const { return cells_.get()->max_slope; }

private:
  anhyst_cells_state_f64 demagnetised() const
  {
    const double nothing[ANHYST_CELLS_MAX] = {};
    anhyst_cells_state_f64 now{};
    anhyst_cells_enter_f64(cells_.get(), nothing, &now);
    return now;
  }

  // Returns the end index of each drive, from the start indices of all drives.
  static std::vector<size_t> ends_of(const Places &begins, size_t n)
  {
    std::vector<size_t> ends;
    for (size_t k = 0; k < begins.shape(0); k++) {
      const int64_t end = k + 1 < begins.shape(0) ? begins.data()[k + 1] : static_cast<int64_t>(n);
      if ((k == 0 && begins.data()[0] != 0) || end < begins.data()[k] ||
          end > static_cast<int64_t>(n)) {
        throw std::invalid_argument("begins must ascend from 0 to at most the number of samples");
      }
      ends.push_back(static_cast<size_t>(end));
    }
    return ends;
  }

  Cells cells_;
};

} // namespace

void bind_cells(nb::module_ &m)
{
  nb::class_<CellOperator>(m, "CellOperator")
      .def(nb::init<const In &, const In &, const InTable &, const std::string &, double,
                    const std::optional<In> &>(),
           "thresholds"_a.noconvert(), "widths"_a.noconvert(), "weights"_a.noconvert(),
           "shape"_a = "tanh", "aim"_a = ANHYST_CELLS_AIM, "centres"_a.noconvert() = nb::none())
      .def_prop_ro("steepest", &CellOperator::steepest)
      .def("run", &CellOperator::run, "omega"_a.noconvert(), "r"_a.noconvert(),
           "begins"_a.noconvert())
      .def("sensitivity", &CellOperator::sensitivity, "omega"_a.noconvert(), "r"_a.noconvert(),
           "omega_t"_a.noconvert(), "r_t"_a.noconvert(), "weights_t"_a.noconvert(),
           "widths_t"_a.noconvert(), "thresholds_t"_a.noconvert(), "begins"_a.noconvert());
}
