// SPDX-License-Identifier: Apache-2.0
// The simulated plant, together with the data it points to.
#pragma once

#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <string>
#include <vector>

#include "anhyst_plant/body.h"
#include "iron.h"
#include "settings.h"
#include "steel.h"

// A magnet, together with the data it points to.
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
    circuit_.bias = given.take<double>("bias");
    circuit_.middle = given.take<double>("middle");
    circuit_.spring = given.take<double>("spring");
    magnet_.circuit = &circuit_;
    read_winding(given);
  }

  // An iron with solid volumes in its path, the surface first.
  // `share` and `drag`: fraction of the cross-section and eddy-current coefficient per volume.
  Magnet(const nb::dict &numbers, const Steel &steel, double part, const In &share, const In &drag)
      : Magnet(numbers, steel)
  {
    same_length(share.shape(0), drag.shape(0), "drag");
    if (share.shape(0) < 1 || share.shape(0) > ANHYST_PLANT_MAX_VOLUMES ||
        !(part > 0.0 && part <= 1.0)) {
      throw std::invalid_argument("1 to 16 volumes, in a part of the path above 0 and up to 1");
    }
    solid_.volumes = static_cast<int>(share.shape(0));
    solid_.part = part;
    std::copy(share.data(), share.data() + share.size(), solid_.share);
    std::copy(drag.data(), drag.data() + drag.size(), solid_.drag);
    circuit_.solid = &solid_;
  }

  // A solenoid: an iron in a circuit with a conical gap.
  Magnet(const nb::dict &numbers, const Steel &steel, const nb::dict &cone) : Magnet(numbers, steel)
  {
    Settings given(cone);
    cone_ = {given.take<double>("leakage"),   given.take<double>("side"),
             given.take<double>("fringe"),    given.take<double>("around"),
             given.take<double>("clearance"), given.take<double>("depth"),
             given.take<double>("onset"),     given.take<double>("thickness"),
             given.take<double>("taper"),     given.take<double>("saturation")};
    given.finish();
    circuit_.cone = &cone_;
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
    read_winding(given);
  }
  Magnet(const Magnet &) = delete;
  Magnet &operator=(const Magnet &) = delete;

  const anhyst_plant_magnet &get() const { return magnet_; }
  // Returns demagnetised states, one for each volume of the solid iron.
  std::vector<anhyst_plant_memory> volumes() const
  {
    return std::vector<anhyst_plant_memory>(static_cast<size_t>(solid_.volumes));
  }

private:
  void read_winding(Settings &given)
  {
    magnet_.turns = given.take<double>("turns");
    magnet_.resistance = given.take<double>("resistance");
    given.finish();
  }

  anhyst_plant_solid solid_{};
  anhyst_plant_cone cone_{};
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
  if (found.delay < 0 || found.delay >= ANHYST_PLANT_MAX_DELAY) {
    throw std::invalid_argument("a sensor is late by 0 to 255 sub-steps");
  }
  return found;
}

using Three = std::array<double, 3>;

inline void copy_three(const Three &from, double *to) { std::copy(from.begin(), from.end(), to); }

inline anhyst_plant_line to_line(const nb::dict &numbers)
{
  Settings given(numbers);
  anhyst_plant_line found;
  copy_three(given.take<Three>("r"), found.r);
  copy_three(given.take<Three>("d"), found.d);
  given.finish();
  return found;
}

inline anhyst_plant_amplifier to_amplifier(const nb::dict &numbers)
{
  Settings given(numbers);
  const anhyst_plant_amplifier found = {given.take<double>("limit"), given.take<double>("gain"),
                                        given.take<double>("reset"), given.take<double>("low"),
                                        given.take<double>("high"),  given.take<double>("step")};
  given.finish();
  return found;
}

// A body with its magnets, heads and load drive; the settings have the names of body.h.
class Plant {
public:
  Plant(const nb::dict &body, const std::vector<nb::dict> &actuators,
        const std::vector<nb::dict> &heads, const nb::dict &load,
        const std::vector<nb::object> &magnets, uint64_t seed)
      : magnets_(magnets)
  {
    if (actuators.size() != magnets.size() || heads.empty()) {
      throw std::invalid_argument("each actuator has a magnet, and there is a position head");
    }
    read_body(body);
    for (size_t i = 0; i < actuators.size(); i++) {
      read_actuator(actuators[i], nb::cast<const Magnet &>(magnets[i]));
    }
    for (const nb::dict &head : heads) {
      Settings given(head);
      heads_.push_back({to_line(given.take<nb::dict>("line")), given.take<double>("zero"),
                        to_sensor(given.take<nb::dict>("sensor")),
                        static_cast<anhyst_plant_base>(given.take<int>("base"))});
      given.finish();
    }
    read_load(load);
    body_.magnets = static_cast<int>(actuators_.size());
    body_.actuator = actuators_.data();
    body_.heads = static_cast<int>(heads_.size());
    body_.head = heads_.data();
    actuator_states_.resize(actuators_.size());
    head_states_.resize(heads_.size());
    state_.actuator = actuator_states_.data();
    state_.head = head_states_.data();
    if (!anhyst_plant_start(&body_, &state_, seed)) {
      throw std::invalid_argument("mass and inertia are those of no body");
    }
    for (size_t i = 0; i < magnets.size(); i++) {
      volumes_.push_back(nb::cast<const Magnet &>(magnets[i]).volumes());
      actuator_states_[i].coil.volume = volumes_.back().data();
    }
  }
  Plant(const Plant &) = delete;
  Plant &operator=(const Plant &) = delete;

  nb::tuple read()
  {
    std::vector<double> head(heads_.size());
    std::vector<double> current(actuators_.size());
    std::vector<double> density(actuators_.size());
    anhyst_plant_readings r = {head.data(), current.data(), density.data(), 0.0};
    anhyst_plant_read(&body_, &state_, &r);
    return nb::make_tuple(head, current, density, r.force);
  }
  void advance(const std::vector<double> &command, double load)
  {
    same_length(command.size(), actuators_.size(), "command");
    anhyst_plant_advance(&body_, &state_, command.data(), load);
  }
  void set_pose(const std::vector<double> &pose, const std::vector<double> &velocity)
  {
    same_length(pose.size(), static_cast<size_t>(body_.coordinates), "pose");
    same_length(velocity.size(), static_cast<size_t>(body_.coordinates), "velocity");
    anhyst_plant_place(&body_, &state_, pose.data(), velocity.data());
  }
  void hold_current(double current, int magnet)
  {
    if (magnet < 0 || magnet >= body_.magnets) {
      throw std::invalid_argument("no such magnet");
    }
    anhyst_plant_hold(&body_, &state_, magnet, current);
  }

  void set_load(double damping, double stiffness)
  {
    body_.load.damping = damping;
    body_.load.stiffness = stiffness;
  }
  void set_supply(double volts)
  {
    for (anhyst_plant_actuator &actuator : actuators_) {
      actuator.amplifier.limit = volts;
    }
  }
  double supply() const { return actuators_.front().amplifier.limit; }
  const anhyst_plant_body *body() const { return &body_; }
  anhyst_plant_state *state() { return &state_; }

  // Returns the values in the free coordinates only.
  std::vector<double> along(const double *axes) const
  {
    std::vector<double> found;
    for (int k = 0; k < body_.coordinates; k++) {
      found.push_back(axes[body_.coordinate[k].axis]);
    }
    return found;
  }

private:
  void read_body(const nb::dict &numbers)
  {
    Settings given(numbers);
    for (const nb::dict &one : given.take<std::vector<nb::dict>>("coordinate")) {
      Settings own(one);
      const anhyst_plant_coordinate found = {
          own.take<int>("axis"),           own.take<double>("rest"),
          own.take<double>("damping"),     own.take<double>("stop_low"),
          own.take<double>("stop_high"),   own.take<double>("stop_stiffness"),
          own.take<double>("stop_damping")};
      own.finish();
      const int before = body_.coordinates ? body_.coordinate[body_.coordinates - 1].axis : -1;
      if (found.axis <= before || found.axis >= ANHYST_PLANT_AXES) {
        throw std::invalid_argument("axes of coordinates are 0 to 5, rising");
      }
      body_.coordinate[body_.coordinates++] = found;
    }
    body_.mass = given.take<double>("mass");
    copy_three(given.take<Three>("centre"), body_.centre);
    const auto inertia = given.take<std::array<Three, 3>>("inertia");
    for (size_t i = 0; i < 3; i++) {
      copy_three(inertia[i], body_.inertia[i]);
    }
    copy_three(given.take<Three>("gravity"), body_.gravity);
    copy_three(given.take<Three>("force_along"), body_.force_along);
    Settings cable(given.take<nb::dict>("cable"));
    copy_three(cable.take<Three>("at"), body_.cable.at);
    body_.cable.stiffness = cable.take<double>("stiffness");
    body_.cable.damping = cable.take<double>("damping");
    cable.finish();
    body_.force_sensor = to_sensor(given.take<nb::dict>("force_sensor"));
    body_.tick = given.take<double>("tick");
    body_.substeps = given.take<int>("substeps");
    body_.delay = given.take<int>("delay");
    given.finish();
    if (body_.coordinates < 1) {
      throw std::invalid_argument("a body is free in one coordinate or more");
    }
    if (body_.substeps < 1 || body_.delay < 0 || body_.delay > ANHYST_PLANT_MAX_DELAY / 2) {
      throw std::invalid_argument("one sub-step or more, and a delay of 0 to 128 of them");
    }
  }
  void read_actuator(const nb::dict &numbers, const Magnet &magnet)
  {
    Settings given(numbers);
    actuators_.push_back({magnet.get(), to_line(given.take<nb::dict>("line")),
                          given.take<double>("gap_zero"),
                          to_amplifier(given.take<nb::dict>("amplifier")),
                          to_sensor(given.take<nb::dict>("current_sensor")),
                          to_sensor(given.take<nb::dict>("flux_probe")),
                          given.take<int>("has_probe"), given.take<double>("sense_turns")});
    given.finish();
  }
  void read_load(const nb::dict &numbers)
  {
    Settings given(numbers);
    body_.load = {to_line(given.take<nb::dict>("line")),
                  given.take<double>("share"),
                  given.take<double>("damping"),
                  given.take<double>("stiffness"),
                  given.take<double>("rest"),
                  given.take<double>("encoder_step"),
                  given.take<double>("velocity_share")};
    given.finish();
  }

  std::vector<nb::object> magnets_;
  std::vector<anhyst_plant_actuator> actuators_;
  std::vector<anhyst_plant_head> heads_;
  std::vector<anhyst_plant_actuator_state> actuator_states_;
  std::vector<std::vector<anhyst_plant_memory>> volumes_; // states of the solid iron of each magnet
  std::vector<anhyst_plant_head_state> head_states_;
  anhyst_plant_body body_{};
  anhyst_plant_state state_{};
};
