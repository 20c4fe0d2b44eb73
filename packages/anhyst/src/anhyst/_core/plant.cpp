// SPDX-License-Identifier: Apache-2.0
// The simulated plant in Python: it converts and checks arguments, and contains no other logic.
#include <cmath>

#include "anhyst_plant/held.h"
#include "plant.h"

namespace {

// A single winding at imposed currents and gaps, or driven by a voltage.
class Coil {
public:
  explicit Coil(const Magnet &magnet) : magnet_(magnet.get()), volumes_(magnet.volumes())
  {
    coil_.volume = volumes_.data();
  }
  Coil(const Coil &) = delete;
  Coil &operator=(const Coil &) = delete;

  double hold_current(double current, double gap)
  {
    anhyst_plant_coil_lead(&magnet_, &coil_, current, gap, 0.0);
    return coil_.force;
  }
  void lead_current(double current, double gap, double seconds)
  {
    anhyst_plant_coil_lead(&magnet_, &coil_, current, gap, 1.0 / seconds);
  }
  void apply_voltage(double voltage, double gap, double seconds)
  {
    const anhyst_plant_source source = {0.0, 0.0, 0.0, voltage, HUGE_VAL};
    anhyst_plant_coil_step(&magnet_, &coil_, &source, gap, seconds);
  }
  // Applies currents, slowly or within the given seconds each.
  // Returns rows of force, flux linkage and flux density in the gap.
  OutTable run(const In &current, const In &gap, double seconds)
  {
    same_length(current.shape(0), gap.shape(0), "gap");
    OutTable out = make_table(current.shape(0), 3);
    for (size_t i = 0; i < current.shape(0); i++) {
      if (std::isinf(seconds)) {
        hold_current(current(i), gap(i));
      } else {
        anhyst_plant_coil_follow(&magnet_, &coil_, current(i), gap(i), seconds);
      }
      double *row = out.data() + 3 * i;
      row[0] = coil_.force;
      row[1] = coil_.psi;
      row[2] = coil_.density;
    }
    return out;
  }
  const anhyst_plant_coil &get() const { return coil_; }

private:
  anhyst_plant_magnet magnet_;
  std::vector<anhyst_plant_memory> volumes_;
  anhyst_plant_coil coil_{};
};

// A sensor; the caller supplies the noise.
class Sensor {
public:
  explicit Sensor(const nb::dict &numbers) : sensor_(to_sensor(numbers)) {}

  Out run(const In &values, const In &noise)
  {
    same_length(values.shape(0), noise.shape(0), "noise");
    Out out = make_array(values.shape(0));
    for (size_t i = 0; i < values.shape(0); i++) {
      out.data()[i] = anhyst_plant_sensor_take(&sensor_, &sensing_, !begun_, values(i), noise(i));
      begun_ = true;
    }
    return out;
  }

private:
  anhyst_plant_sensor sensor_;
  anhyst_plant_sensing sensing_{};
  bool begun_ = false;
};

// An actuator whose armature is moved from outside, with amplifier and sensors.
class HeldPlant {
public:
  HeldPlant(const nb::dict &numbers, const std::vector<nb::dict> &sensors, const Magnet &magnet)
      : volumes_(magnet.volumes())
  {
    same_length(sensors.size(), ANHYST_HELD_SENSORS, "sensors");
    Settings given(numbers);
    held_ = {magnet.get(),
             given.take<double>("seconds"),
             given.take<double>("low"),
             given.take<double>("high"),
             given.take<double>("step"),
             given.take<double>("share"),
             given.take<double>("most"),
             given.take<double>("zero"),
             {to_sensor(sensors[0]), to_sensor(sensors[1]), to_sensor(sensors[2])}};
    given.finish();
    state_.coil.volume = volumes_.data();
  }
  HeldPlant(const HeldPlant &) = delete;
  HeldPlant &operator=(const HeldPlant &) = delete;

  void hold_current(double current, double gap)
  {
    anhyst_plant_coil_lead(&held_.magnet, &state_.coil, current, gap, 0.0);
  }
  // Returns rows of current, force, and the sensor readings of gap, force and current.
  OutTable run(const In &reference, const In &gap, const InTable &noise)
  {
    same_length(reference.shape(0), gap.shape(0), "gap");
    same_length(reference.shape(0), noise.shape(0), "noise");
    same_length(noise.shape(1), ANHYST_HELD_SENSORS, "a row of noise");
    OutTable out = make_table(reference.shape(0), ANHYST_HELD_COLUMN_COUNT);
    for (size_t i = 0; i < reference.shape(0); i++) {
      anhyst_plant_held_tick(&held_, &state_, reference(i), gap(i), &noise(i, 0),
                             out.data() + i * ANHYST_HELD_COLUMN_COUNT);
    }
    return out;
  }

private:
  anhyst_plant_held held_{};
  std::vector<anhyst_plant_memory> volumes_;
  anhyst_plant_held_state state_{};
};

// Returns a row per magnet: gap, current, flux linkage, pull, energy input and heat output.
OutTable coil_rows(Plant &plant)
{
  const auto magnets = static_cast<size_t>(plant.body()->magnets);
  OutTable out = make_table(magnets, 6);
  for (size_t i = 0; i < magnets; i++) {
    const anhyst_plant_actuator_state &s = plant.state()->actuator[i];
    const double row[6] = {s.gap,        s.coil.current, s.coil.psi,
                           s.coil.force, s.coil.energy,  s.coil.heat};
    std::copy(row, row + 6, out.data() + 6 * i);
  }
  return out;
}

} // namespace

void bind_plant(nb::module_ &m)
{
  nb::class_<Steel>(m, "Steel")
      .def(nb::init<const nb::dict &, const In &, const In &>(), "numbers"_a,
           "thresholds"_a.noconvert(), "weights"_a.noconvert())
      .def(nb::init<const nb::dict &, const InTable &>(), "numbers"_a, "everett"_a.noconvert())
      .def(nb::init<const nb::dict &>(), "numbers"_a);
  nb::class_<Piece>(m, "Piece")
      .def(nb::init<const Steel &>(), "steel"_a, nb::keep_alive<1, 2>())
      .def("flux_density", &Piece::flux_density, "field"_a)
      .def("commit", &Piece::commit, "field"_a)
      .def("solve", &Piece::solve, "a"_a, "b"_a, "r"_a)
      .def("run", &Piece::run, "field"_a.noconvert())
      .def("demagnetise", &Piece::demagnetise)
      .def_prop_ro("field", [](const Piece &p) { return p.get().field; })
      .def_prop_ro("density", [](const Piece &p) { return p.get().density; });
  nb::class_<Magnet>(m, "Magnet")
      .def(nb::init<const nb::dict &, const Steel &>(), "numbers"_a, "steel"_a,
           nb::keep_alive<1, 3>())
      .def(nb::init<const nb::dict &, const Steel &, double, const In &, const In &>(), "numbers"_a,
           "steel"_a, "part"_a, "share"_a.noconvert(), "drag"_a.noconvert(), nb::keep_alive<1, 3>())
      .def(nb::init<const nb::dict &, const Steel &, const nb::dict &>(), "numbers"_a, "steel"_a,
           "cone"_a, nb::keep_alive<1, 3>())
      .def(nb::init<const nb::dict &, const AnyIron &, const InTable &, const InTable &>(),
           "numbers"_a, "iron"_a, "rows"_a.noconvert(), "psi"_a.noconvert(),
           nb::keep_alive<1, 3>());
  nb::class_<Coil>(m, "Coil")
      .def(nb::init<const Magnet &>(), "magnet"_a, nb::keep_alive<1, 2>())
      .def("hold", &Coil::hold_current, "current"_a, "gap"_a)
      .def("lead", &Coil::lead_current, "current"_a, "gap"_a, "seconds"_a)
      .def("step", &Coil::apply_voltage, "voltage"_a, "gap"_a, "seconds"_a)
      .def("run", &Coil::run, "current"_a.noconvert(), "gap"_a.noconvert(), "seconds"_a = HUGE_VAL)
      .def_prop_ro("force", [](const Coil &c) { return c.get().force; })
      .def_prop_ro("psi", [](const Coil &c) { return c.get().psi; })
      .def_prop_ro("density", [](const Coil &c) { return c.get().density; })
      .def_prop_ro("current", [](const Coil &c) { return c.get().current; })
      .def_prop_ro("heat", [](const Coil &c) { return c.get().heat; })
      .def_prop_ro("energy", [](const Coil &c) { return c.get().energy; });
  nb::class_<Sensor>(m, "Sensor")
      .def(nb::init<const nb::dict &>(), "numbers"_a)
      .def("run", &Sensor::run, "values"_a.noconvert(), "noise"_a.noconvert());
  nb::class_<HeldPlant>(m, "HeldPlant")
      .def(nb::init<const nb::dict &, const std::vector<nb::dict> &, const Magnet &>(), "numbers"_a,
           "sensors"_a, "magnet"_a, nb::keep_alive<1, 4>())
      .def("hold", &HeldPlant::hold_current, "current"_a, "gap"_a)
      .def("run", &HeldPlant::run, "reference"_a.noconvert(), "gap"_a.noconvert(),
           "noise"_a.noconvert());
  nb::class_<Plant>(m, "Plant")
      .def(nb::init<const nb::dict &, const std::vector<nb::dict> &, const std::vector<nb::dict> &,
                    const nb::dict &, const std::vector<nb::object> &, uint64_t>(),
           "body"_a, "actuators"_a, "heads"_a, "load"_a, "magnets"_a, "seed"_a)
      .def("read", &Plant::read)
      .def("advance", &Plant::advance, "commands"_a, "load"_a)
      .def("place", &Plant::set_pose, "pose"_a, "velocity"_a)
      .def("set_load", &Plant::set_load, "damping"_a, "stiffness"_a)
      .def("hold", &Plant::hold_current, "current"_a, "magnet"_a)
      .def_prop_rw("supply", &Plant::supply, &Plant::set_supply)
      .def_prop_ro("pose", [](Plant &p) { return p.along(p.state()->pose); })
      .def_prop_ro("velocities", [](Plant &p) { return p.along(p.state()->velocity); })
      .def_prop_ro("wrench", [](Plant &p) { return p.along(p.state()->wrench); })
      .def("coils", coil_rows)
      .def_prop_ro("gap", [](Plant &p) { return p.state()->actuator[0].gap; })
      .def_prop_ro("velocity", [](Plant &p) { return p.along(p.state()->velocity).front(); })
      .def_prop_ro("force", [](Plant &p) { return p.state()->force; })
      .def_prop_ro("current", [](Plant &p) { return p.state()->actuator[0].coil.current; })
      .def_prop_ro("psi", [](Plant &p) { return p.state()->actuator[0].coil.psi; });
}
