// SPDX-License-Identifier: Apache-2.0
// Array arguments and results: float64, C-contiguous, never converted silently.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdexcept>
#include <string>

#include "anhyst/law/operator.h"

namespace nb = nanobind;
using nb::literals::operator""_a;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InTable = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InCube = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using InOut = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<nb::numpy, double, nb::ndim<1>>;
using OutTable = nb::ndarray<nb::numpy, double, nb::ndim<2>>;

inline Out make_array(size_t n)
{
  double *data = new double[n];
  nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
  return Out(data, {n}, owner);
}

// Takes ownership of an array of doubles that new[] allocated.
inline OutTable own_table(double *data, size_t rows, size_t columns)
{
  nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
  return OutTable(data, {rows, columns}, owner);
}

inline OutTable make_table(size_t rows, size_t columns)
{
  return own_table(new double[rows * columns], rows, columns);
}

inline void same_length(size_t expected, size_t found, const char *what)
{
  if (expected != found) {
    throw std::invalid_argument(std::string(what) + " has the wrong length");
  }
}

inline void same_shape(size_t rows, size_t columns, const InTable &found, const char *what)
{
  same_length(rows, found.shape(0), what);
  same_length(columns, found.shape(1), what);
}

inline anhyst_state_f64 to_state(const In &values)
{
  if (values.shape(0) != 3) {
    throw std::invalid_argument("a state has three values: x/a, M_irr/M_s, p/a");
  }
  return {values(0), values(1), values(2)};
}

inline Out from_state(const anhyst_state_f64 &state)
{
  Out out = make_array(3);
  out.data()[0] = state.x;
  out.data()[1] = state.y;
  out.data()[2] = state.p;
  return out;
}

anhyst_step to_step(const std::string &law, const std::string &step);

void bind_identification(nb::module_ &m);
void bind_cells(nb::module_ &m);
void bind_compensator(nb::module_ &m);
void bind_control(nb::module_ &m);
void bind_supervisor(nb::module_ &m);
void bind_force_controllers(nb::module_ &m);
void bind_plant(nb::module_ &m);
void bind_loop(nb::module_ &m);
void bind_tracking(nb::module_ &m);
void bind_axes_fixed(nb::module_ &m);
void bind_piezo(nb::module_ &m);
void bind_position(nb::module_ &m);
void bind_bus(nb::module_ &m);
