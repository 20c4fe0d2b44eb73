// SPDX-License-Identifier: Apache-2.0
// Iron classes: each simulates whole records with a hysteresis law and its tables.
#pragma once

#include <memory>
#include <vector>

#include "anhyst/law/circuit.h"
#include "arrays.h"
#include "cells.h"

// Base class of the irons of all hysteresis laws.
class AnyIron {
public:
  nb::tuple record(int inverse, const In &given, const In &rho, const In &eddy,
                   const In &state) const
  {
    same_length(given.shape(0), rho.shape(0), "rho");
    same_length(given.shape(0), eddy.shape(0), "eddy");
    const size_t n = given.shape(0);
    Out found = make_array(n);
    Out field = make_array(n);
    Memories now;
    size_t index = 0;
    anhyst_status status = enter(state, &now);
    if (status == ANHYST_OK) {
      nb::gil_scoped_release release;
      status = anhyst_record_f64(&iron_, now.data(), inverse, n, given.data(), rho.data(),
                                 eddy.data(), found.data(), field.data(), &index);
    }
    return nb::make_tuple(found, field, leave(now), static_cast<int>(status), index);
  }

  nb::tuple settle(const In &given, const In &rho, const In &eddy, const In &state, bool inverse,
                   int max_cycles, double tol) const
  {
    same_length(given.shape(0), rho.shape(0), "rho");
    same_length(given.shape(0), eddy.shape(0), "eddy");
    Memories now;
    size_t index = 0;
    int cycles = 0;
    anhyst_status status = enter(state, &now);
    if (status == ANHYST_OK) {
      nb::gil_scoped_release release;
      status = anhyst_settle_f64(&iron_, now.data(), inverse, given.shape(0), given.data(),
                                 rho.data(), eddy.data(), tol, max_cycles, &cycles, &index);
    }
    return nb::make_tuple(leave(now), cycles, static_cast<int>(status));
  }

  int check_state(const In &state) const
  {
    Memories now;
    return enter(state, &now);
  }

  double flux_of(const In &state) const
  {
    Memories now;
    enter(state, &now);
    return anhyst_flux_of_f64(&iron_, now.data());
  }

  void make_solid(int layers, double surface, double laminated)
  {
    if (anhyst_iron_layers_f64(&iron_, layers, surface, laminated) != ANHYST_OK) {
      throw std::invalid_argument("layers: 1 to 16 of them, the share of the surface above 0 and "
                                  "below 1 if there are more, what is laminated from 0 to below 1");
    }
  }

  void set_eddy_circuit(double leaky, double leaky_delay, double excess)
  {
    if (anhyst_iron_eddy_circuit_f64(&iron_, leaky, leaky_delay, excess) != ANHYST_OK) {
      throw std::invalid_argument("eddy circuit: one layer, the leaky fraction from 0 to 1, delay "
                                  "and excess field 0 or above");
    }
  }

  const anhyst_iron_f64 *get() const { return &iron_; }

protected:
  using Memories = std::vector<anhyst_memory_f64>;

  AnyIron() = default;
  AnyIron(const AnyIron &) = delete;
  AnyIron &operator=(const AnyIron &) = delete;

  anhyst_iron_f64 iron_{};

private:
  size_t numbers() const { return static_cast<size_t>(iron_.law->numbers(iron_.parameters)); }

  size_t hysteresis_memories() const
  {
    return static_cast<size_t>(anhyst_hysteresis_memories_f64(&iron_));
  }

  anhyst_status enter(const In &state, Memories *now) const
  {
    now->resize(static_cast<size_t>(anhyst_memories_f64(&iron_)));
    const size_t hysteresis_numbers = numbers() * hysteresis_memories();
    same_length(hysteresis_numbers + now->size() - hysteresis_memories(), state.shape(0),
                "the state");
    for (size_t i = 0; i < hysteresis_memories(); i++) {
      const double *own = state.data() + i * numbers();
      const anhyst_status status = iron_.law->enter(iron_.parameters, own, &(*now)[i]);
      if (status != ANHYST_OK) {
        return status;
      }
    }
    if (now->size() > hysteresis_memories()) { // a leaky ring
      now->back().flux = state.data()[hysteresis_numbers];
    }
    return ANHYST_OK;
  }

  Out leave(const Memories &now) const
  {
    const size_t hysteresis_numbers = numbers() * hysteresis_memories();
    Out left = make_array(hysteresis_numbers + now.size() - hysteresis_memories());
    for (size_t i = 0; i < hysteresis_memories(); i++) {
      iron_.law->leave(iron_.parameters, &now[i], left.data() + i * numbers());
    }
    if (now.size() > hysteresis_memories()) {
      left.data()[hysteresis_numbers] = now.back().flux;
    }
    return left;
  }
};

// An iron of a law with the Langevin curve, with its table.
class LagIron : public AnyIron {
public:
  LagIron(double m_s, double a, double k, double c, double alpha, double r_d,
          const std::string &law, const std::string &step)
  {
    const anhyst_step kind = to_step(law, step);
    if (kind == ANHYST_STEP_EXACT) {
      branch_ = std::make_unique<anhyst_branch_f64>();
      if (!(a > 0.0) || anhyst_branch_build_f64(branch_.get(), k / a) != ANHYST_OK) {
        throw std::invalid_argument("k/a must lie between 0.001 and 1000");
      }
    }
    if (anhyst_iron_init_f64(&iron_, &law_, kind, m_s, a, k, c, alpha, r_d, branch_.get()) !=
        ANHYST_OK) {
      throw std::invalid_argument(
          "parameters out of range: M_s, a, k > 0, 0.001 <= k/a <= 1000, 0 <= c <= 1, alpha < 1, "
          "r_d >= 0, and for the law of 1986 alpha*c*M_s/a <= 2.85");
    }
  }

private:
  std::unique_ptr<anhyst_branch_f64> branch_;
  anhyst_operator_f64 law_{};
};

// An iron of play cells.
class CellIron : public AnyIron {
public:
  CellIron(const In &thresholds, const In &widths, const InTable &weights, const std::string &shape,
           double alpha, const std::optional<In> &centres)
      : cells_(thresholds, widths, weights, shape, centres)
  {
    if (anhyst_iron_of_cells_f64(&iron_, cells_.get(), alpha) != ANHYST_OK) {
      throw std::invalid_argument("parameters out of range: alpha < 1");
    }
  }

  double steepest() const { return cells_.get()->max_slope; }

private:
  Cells cells_;
};
