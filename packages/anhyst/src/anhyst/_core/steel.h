// SPDX-License-Identifier: Apache-2.0
// A material of the simulated plant, and a piece of it with its state.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "anhyst_plant/iron.h"
#include "arrays.h"
#include "settings.h"

class Steel {
public:
  // Creates a steel of pinned play cells.
  Steel(const nb::dict &numbers, const In &thresholds, const In &weights)
  {
    Settings given(numbers);
    anhyst_plant_cell_steel &steel = iron_.steel.cells;
    same_length(thresholds.shape(0), weights.shape(0), "weights");
    if (thresholds.shape(0) < 1 || thresholds.shape(0) > ANHYST_PLANT_MAX_CELLS) {
      throw std::invalid_argument("an iron has 1 to 64 cells");
    }
    iron_.family = &anhyst_plant_of_cells;
    steel.cells = static_cast<int>(thresholds.shape(0));
    std::copy_n(thresholds.data(), thresholds.shape(0), steel.threshold);
    std::copy_n(weights.data(), weights.shape(0), steel.weight);
    steel.curve = read_curve(given);
    given.finish();
  }

  // Creates a steel of Preisach relays from their Everett function.
  Steel(const nb::dict &numbers, const InTable &everett)
  {
    Settings given(numbers);
    anhyst_plant_preisach_steel &steel = iron_.steel.preisach;
    if (everett.shape(0) < 2 || everett.shape(0) != everett.shape(1)) {
      throw std::invalid_argument("an Everett table is a square of two nodes or more");
    }
    iron_.family = &anhyst_plant_of_preisach;
    everett_.assign(everett.data(), everett.data() + everett.size());
    steel.everett = everett_.data();
    steel.nodes = static_cast<int>(everett.shape(0));
    steel.knee = given.take<double>("knee");
    steel.reach = given.take<double>("reach");
    steel.feedback = given.take<double>("feedback");
    steel.curve = read_curve(given);
    given.finish();
    const double relays = *std::max_element(everett_.begin(), everett_.end());
    iron_.slack =
        std::fabs(steel.feedback) * (relays + 2.0 * (steel.curve.sharp + steel.curve.slow));
  }

  // Creates a steel that is a Duhem model.
  explicit Steel(const nb::dict &numbers)
  {
    Settings given(numbers);
    anhyst_plant_duhem_steel &steel = iron_.steel.duhem;
    iron_.family = &anhyst_plant_of_duhem;
    steel.coercivity = given.take<double>("coercivity");
    steel.rate = given.take<double>("rate");
    steel.fading = given.take<double>("fading");
    steel.curve = read_curve(given);
    given.finish();
    iron_.slack = 4.0 * steel.coercivity;
  }
  Steel(const Steel &) = delete;
  Steel &operator=(const Steel &) = delete;

  const anhyst_plant_iron &get() const { return iron_; }

private:
  static anhyst_plant_curve read_curve(Settings &given)
  {
    return {given.take<double>("sharp"), given.take<double>("knee_sharp"),
            given.take<double>("slow"), given.take<double>("knee_slow")};
  }

  anhyst_plant_iron iron_{};
  std::vector<double> everett_;
};

// A piece of steel with its hysteresis state, which is initially demagnetised.
class Piece {
public:
  explicit Piece(const Steel &steel) : iron_(steel.get()) {}

  // Returns the flux density and dB/dH that a change to this field would give.
  nb::tuple flux_density(double field) const
  {
    const anhyst_plant_goal goal = seek(1.0, 0.0, field);
    return nb::make_tuple(goal.density, goal.density_slope / goal.field_slope);
  }
  void commit(double field) { solve(1.0, 0.0, field); }
  double solve(double a, double b, double r)
  {
    const anhyst_plant_goal goal = seek(a, b, r);
    anhyst_plant_move(&iron_, &memory_, &goal);
    return memory_.field;
  }
  // Applies fields one after the other, and returns rows of field and flux density.
  OutTable run(const In &field)
  {
    OutTable out = make_table(field.shape(0), 2);
    for (size_t i = 0; i < field.shape(0); i++) {
      commit(field(i));
      out.data()[2 * i] = memory_.field;
      out.data()[2 * i + 1] = memory_.density;
    }
    return out;
  }
  void demagnetise() { memory_ = {}; }
  const anhyst_plant_memory &get() const { return memory_; }

private:
  // Returns the field at which a*H + b*B = r, with a tolerance of 1e-12 * (a + |r|).
  anhyst_plant_goal seek(double a, double b, double r) const
  {
    anhyst_plant_goal goal;
    anhyst_plant_field(&iron_, &memory_, a, b, r, 1e-12 * (a + std::fabs(r)), nullptr, &goal);
    return goal;
  }

  anhyst_plant_iron iron_;
  anhyst_plant_memory memory_{};
};
