// SPDX-License-Identifier: Apache-2.0
// The force controller of a magnet in Python, in each number format.
// It runs the same C functions as a real controller.
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include "force_controllers.h"

namespace {

// Returns the exponent n of a table axis with 2^n segments.
uint16_t to_exponent(size_t entries)
{
  uint16_t n = 0;
  while ((size_t{1} << n) + 1 < entries) {
    n++;
  }
  same_length((size_t{1} << n) + 1, entries, "a row or column of a map, 2^n + 1,");
  return n;
}

template <class F> void bind_real(nb::module_ &m, const char *name)
{
  using Bound = RealForceController<F>;
  nb::class_<Bound>(m, name)
      .def_static("map", &Bound::map, "entries"_a.noconvert(), "force_low"_a, "force_high"_a,
                  "gap_low"_a, "gap_high"_a, "low"_a, "high"_a)
      .def_static("play", &Bound::play, "words"_a.noconvert())
      .def_static("compensator", &Bound::compensator, "kind"_a, "words"_a.noconvert())
      .def_static("flux", &Bound::flux, "entries"_a.noconvert(), "wanted"_a.noconvert(),
                  "loop"_a.noconvert(), "force_low"_a, "force_high"_a, "gap_low"_a, "gap_high"_a,
                  "low"_a, "high"_a)
      .def("fuse", &Bound::fuse, "wanted"_a.noconvert(), "loop"_a.noconvert(), "most"_a,
           "force_low"_a, "force_high"_a, "gap_low"_a, "gap_high"_a, "low"_a, "high"_a)
      .def("sense", &Bound::sense, "settings"_a.noconvert())
      .def("estimate", &Bound::estimate)
      .def("solve", &Bound::solve, "demand"_a, "gap"_a, "flux"_a)
      .def("commit", &Bound::commit, "applied"_a, "gap"_a)
      .def("follow", &Bound::follow, "applied"_a.noconvert(), "gap"_a.noconvert())
      .def_prop_ro("flags", &Bound::flags)
      .def("conditioning_length", &Bound::conditioning_length)
      .def("conditioning", &Bound::conditioning, "tick"_a);
}

} // namespace

anhyst_map_q31 FixedForceController::table(const Entries &entries)
{
  tables_.emplace_back(entries.data(), entries.data() + entries.size());
  return {tables_.back().data(), to_exponent(entries.shape(1)), to_exponent(entries.shape(0))};
}

FixedForceController::Made FixedForceController::map(const Entries &entries, int32_t low,
                                                     int32_t high)
{
  Made made(new FixedForceController);
  made->current_ = made->table(entries);
  check_controller(anhyst_force_controller_init_map_q31(&made->state_, &made->current_, low, high));
  return made;
}

FixedForceController::Made FixedForceController::play(const Words<Fixed> &words)
{
  Made made(new FixedForceController);
  made->tables_.emplace_back(words.data(), words.data() + words.size());
  check_controller(anhyst_play_map_init_q31(&made->play_, made->tables_.back().data(),
                                            static_cast<uint16_t>(words.size())));
  anhyst_force_controller_init_play_q31(&made->state_, &made->play_);
  return made;
}

FixedForceController::Made FixedForceController::compensator(const std::string &kind,
                                                             const Words<Fixed> &words)
{
  Made made(new FixedForceController);
  made->tables_.emplace_back(words.data(), words.data() + words.size());
  check_controller(anhyst_force_controller_init_compensator_q31(
      &made->state_, to_kernel<Fixed>(kind), made->tables_.back().data(),
      static_cast<uint16_t>(words.size())));
  return made;
}

FixedForceController::Made FixedForceController::flux(const Entries &entries, const Entries &wanted,
                                                      const Factors &loop, int32_t low,
                                                      int32_t high)
{
  Made made(new FixedForceController);
  made->current_ = made->table(entries);
  made->take_loop(wanted, loop, 0);
  check_controller(anhyst_force_controller_init_flux_q31(&made->state_, &made->current_,
                                                         &made->loop_, low, high));
  return made;
}

void FixedForceController::take_loop(const Entries &wanted, const Factors &loop, int32_t most)
{
  same_length(4, loop.shape(0), "loop");
  same_length(2, loop.shape(1), "a factor of the loop");
  const auto factor = [&](size_t i) { return anhyst_factor{loop(i, 0), loop(i, 1)}; };
  loop_ = {table(wanted), factor(0), factor(1), factor(2), factor(3), most};
}

void FixedForceController::fuse(const Entries &wanted, const Factors &loop, int32_t most,
                                int32_t low, int32_t high)
{
  take_loop(wanted, loop, most);
  check_controller(anhyst_force_controller_fuse_q31(&state_, &loop_, low, high));
}

void FixedForceController::sense(const Codes &settings)
{
  same_length(9, settings.shape(0), "settings");
  const auto *s = settings.data();
  const anhyst_coil_flux_settings_q31 given = {s[0], s[1], s[2], s[3], s[4],
                                               s[5], s[6], s[7], s[8]};
  behind_ = state_;
  check_controller(anhyst_force_controller_init_coil_q31(&state_, &coil_, &given, &behind_));
}

std::array<double, 4> FixedForceController::estimate() const
{
  const auto part = [](int64_t sum) { return static_cast<double>(sum) / ANHYST_WIDE_ONE; };
  const double law = coil_.law / 2147483648.0;
  return {law, law + part(coil_.deviation), part(coil_.offset), part(coil_.resistance)};
}

void bind_force_controllers(nb::module_ &m)
{
  bind_real<ForceControllerF64>(m, "ForceController");
  bind_real<ForceControllerF32>(m, "ForceControllerF32");
  nb::class_<FixedForceController>(m, "FixedForceController")
      .def_static("map", &FixedForceController::map, "entries"_a.noconvert(), "low"_a, "high"_a)
      .def_static("play", &FixedForceController::play, "words"_a.noconvert())
      .def_static("compensator", &FixedForceController::compensator, "kind"_a,
                  "words"_a.noconvert())
      .def_static("flux", &FixedForceController::flux, "entries"_a.noconvert(),
                  "wanted"_a.noconvert(), "loop"_a.noconvert(), "low"_a, "high"_a)
      .def("fuse", &FixedForceController::fuse, "wanted"_a.noconvert(), "loop"_a.noconvert(),
           "most"_a, "low"_a, "high"_a)
      .def("sense", &FixedForceController::sense, "settings"_a.noconvert())
      .def("estimate", &FixedForceController::estimate)
      .def("solve", &FixedForceController::solve, "demand"_a, "gap"_a, "flux"_a)
      .def("commit", &FixedForceController::commit, "applied"_a, "gap"_a)
      .def("follow", &FixedForceController::follow, "applied"_a.noconvert(), "gap"_a.noconvert())
      .def_prop_ro("flags", &FixedForceController::flags)
      .def("conditioning_length", &FixedForceController::conditioning_length)
      .def("conditioning", &FixedForceController::conditioning, "tick"_a);
}
