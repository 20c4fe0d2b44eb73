// SPDX-License-Identifier: Apache-2.0
// The virtual bearing with what it points to.
#pragma once

#include <string>
#include <vector>

#include "anhyst_plant/bearing.h"
#include "iron.h"
#include "settings.h"
#include "steel.h"

// A magnet with what it points to.
class Magnet {
public:
  // An iron in a reluctance circuit.
  Magnet(const nb::dict &numbers, const Steel &steel)
  {
    Settings given(numbers);
    circuit_.iron = steel.get();
    circuit_.iron_length = given.take<double>("iron_length");
    circuit_.iron_area = given.take<double>("iron_area");
    circuit_.pole_width = given.take<double>("pole_width");
    circuit_.pole_depth = given.take<double>("pole_depth");
    circuit_.leakage = given.take<double>("leakage");
    circuit_.joints = given.take<double>("joints");
    circuit_.eddy = given.take<double>("eddy");
    magnet_.circuit = &circuit_;
    winding(given);
  }

  // An identified law with a table of the flux linkage.
  Magnet(const nb::dict &numbers, const AnyIron &iron, const InTable &rows, const InTable &psi)
  {
    Settings given(numbers);
    if (rows.shape(0) < 2 || rows.shape(1) != 6 || psi.shape(0) < 2 || psi.shape(1) < 2) {
      throw std::invalid_argument("a law has two rows of six numbers, its table two by two");
    }
    for (size_t i = 0; i < rows.shape(0); i++) {
      rows_.push_back({rows(i, 0), rows(i, 1), rows(i, 2), rows(i, 3), rows(i, 4), rows(i, 5)});
    }
    psi_.assign(psi.data(), psi.data() + psi.size());
    law_.iron = iron.get();
    law_.rows = rows_.data();
    law_.row_count = static_cast<int>(rows_.size());
    law_.eddy = given.take<double>("eddy");
    law_.table = {psi_.data(),
                  static_cast<int>(psi.shape(1)),
                  static_cast<int>(psi.shape(0)),
                  given.take<double>("current_high"),
                  given.take<double>("gap_low"),
                  given.take<double>("gap_high")};
    magnet_.law = &law_;
    winding(given);
  }
  Magnet(const Magnet &) = delete;
  Magnet &operator=(const Magnet &) = delete;

  const anhyst_plant_magnet &get() const { return magnet_; }

private:
  void winding(Settings &given)
  {
    magnet_.turns = given.take<double>("turns");
    magnet_.resistance = given.take<double>("resistance");
    given.finish();
  }

  anhyst_plant_circuit circuit_{};
  anhyst_plant_law law_{};
  anhyst_plant_magnet magnet_{};
  std::vector<anhyst_plant_row> rows_;
  std::vector<double> psi_;
};

inline anhyst_plant_sensor to_sensor(const nb::dict &numbers)
{
  Settings given(numbers);
  const anhyst_plant_sensor found = {given.take<double>("low"),    given.take<double>("high"),
                                     given.take<double>("step"),   given.take<double>("gain"),
                                     given.take<double>("offset"), given.take<double>("noise"),
                                     given.take<double>("share"),  given.take<int>("delay")};
  given.finish();
  if (found.delay < 0 || found.delay >= ANHYST_PLANT_DELAY_MOST) {
    throw std::invalid_argument("a sensor is late by 0 to 255 sub-steps");
  }
  return found;
}

class Bearing {
public:
  Bearing(const nb::dict &numbers, const nb::dict &amplifier, const nb::dict &load,
          const nb::dict &sensors, const Magnet &first, const Magnet *second, uint64_t seed)
  {
    Settings given(numbers);
    bearing_.magnets = second ? 2 : 1;
    bearing_.magnet[0] = first.get();
    if (second) {
      bearing_.magnet[1] = second->get();
    }
    bearing_.gap_total = given.take<double>("gap_total");
    bearing_.mass = given.take<double>("mass");
    bearing_.damping = given.take<double>("damping");
    bearing_.gravity = given.take<double>("gravity");
    bearing_.stop_low = given.take<double>("stop_low");
    bearing_.stop_high = given.take<double>("stop_high");
    bearing_.stop_stiffness = given.take<double>("stop_stiffness");
    bearing_.stop_damping = given.take<double>("stop_damping");
    bearing_.tick = given.take<double>("tick");
    bearing_.substeps = given.take<int>("substeps");
    bearing_.delay = given.take<int>("delay");
    given.finish();
    if (bearing_.substeps < 1 || bearing_.delay < 0 ||
        bearing_.delay > ANHYST_PLANT_DELAY_MOST / 2) {
      throw std::invalid_argument("one sub-step or more, and a delay of 0 to 128 of them");
    }
    read_amplifier(amplifier);
    read_load(load);
    bearing_.gap_sensor = to_sensor(nb::cast<nb::dict>(sensors["gap"]));
    bearing_.current_sensor = to_sensor(nb::cast<nb::dict>(sensors["current"]));
    bearing_.force_sensor = to_sensor(nb::cast<nb::dict>(sensors["force"]));
    bearing_.hall_probe = to_sensor(nb::cast<nb::dict>(sensors["hall"]));
    anhyst_plant_start(&bearing_, &state_, seed);
  }
  Bearing(const Bearing &) = delete;
  Bearing &operator=(const Bearing &) = delete;

  nb::tuple read()
  {
    anhyst_plant_readings r;
    anhyst_plant_read(&bearing_, &state_, &r);
    return nb::make_tuple(r.gap, r.current[0], r.current[1], r.density[0], r.density[1], r.force);
  }
  void advance(double first, double second, double load)
  {
    const double command[ANHYST_PLANT_MAGNETS] = {first, second};
    anhyst_plant_advance(&bearing_, &state_, command, load);
  }
  void place(double gap, double velocity) { anhyst_plant_place(&bearing_, &state_, gap, velocity); }
  void hold(double current, int magnet)
  {
    if (magnet < 0 || magnet >= bearing_.magnets) {
      throw std::invalid_argument("no such magnet");
    }
    anhyst_plant_hold(&bearing_, &state_, magnet, current);
  }

  void set_load(double damping, double stiffness)
  {
    bearing_.load.damping = damping;
    bearing_.load.stiffness = stiffness;
  }
  void set_supply(double volts) { bearing_.amplifier.limit = volts; }
  const anhyst_plant_bearing *settings() const { return &bearing_; }
  anhyst_plant_state *state() { return &state_; }

private:
  void read_amplifier(const nb::dict &numbers)
  {
    Settings given(numbers);
    bearing_.amplifier = {given.take<double>("limit"), given.take<double>("gain"),
                          given.take<double>("reset"), given.take<double>("low"),
                          given.take<double>("high"),  given.take<double>("step")};
    given.finish();
  }
  void read_load(const nb::dict &numbers)
  {
    Settings given(numbers);
    bearing_.load = {given.take<double>("share"),        given.take<double>("damping"),
                     given.take<double>("stiffness"),    given.take<double>("rest"),
                     given.take<double>("encoder_step"), given.take<double>("velocity_share")};
    given.finish();
  }

  anhyst_plant_bearing bearing_{};
  anhyst_plant_state state_{};
};
