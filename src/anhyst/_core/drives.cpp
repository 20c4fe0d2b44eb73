// SPDX-License-Identifier: Apache-2.0
// The drive of a magnet in Python, in every format: the very functions that run on a controller.
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include "drives.h"

namespace {

// n of 2^n segments.
uint16_t exponent(size_t entries)
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
  using Bound = RealDrive<F>;
  nb::class_<Bound>(m, name)
      .def_static("map", &Bound::map, "entries"_a.noconvert(), "force_high"_a, "gap_low"_a,
                  "gap_high"_a, "low"_a, "high"_a)
      .def_static("compensator", &Bound::compensator, "parameters"_a, nb::keep_alive<0, 1>())
      .def_static("flux", &Bound::flux, "entries"_a.noconvert(), "wanted"_a.noconvert(),
                  "loop"_a.noconvert(), "force_high"_a, "gap_low"_a, "gap_high"_a, "low"_a,
                  "high"_a)
      .def("solve", &Bound::solve, "demand"_a, "gap"_a, "flux"_a)
      .def("commit", &Bound::commit, "applied"_a, "gap"_a)
      .def_prop_ro("flags", &Bound::flags)
      .def("conditioning_length", &Bound::conditioning_length)
      .def("conditioning", &Bound::conditioning, "tick"_a);
}

} // namespace

anhyst_map_q31 FixedDrive::table(const Entries &entries)
{
  tables_.emplace_back(entries.data(), entries.data() + entries.size());
  return {tables_.back().data(), exponent(entries.shape(1)), exponent(entries.shape(0))};
}

FixedDrive::Made FixedDrive::map(const Entries &entries, int32_t low, int32_t high)
{
  Made drive(new FixedDrive);
  drive->current_ = drive->table(entries);
  sound_drive(anhyst_drive_init_map_q31(&drive->state_, &drive->current_, low, high));
  return drive;
}

FixedDrive::Made FixedDrive::compensator(const std::string &kind, const Words &words)
{
  Made drive(new FixedDrive);
  drive->tables_.emplace_back(words.data(), words.data() + words.size());
  sound_drive(anhyst_drive_init_compensator_q31(&drive->state_, to_kernel(kind),
                                                drive->tables_.back().data(),
                                                static_cast<uint16_t>(words.size())));
  return drive;
}

FixedDrive::Made FixedDrive::flux(const Entries &entries, const Entries &wanted,
                                  const Factors &loop, int32_t low, int32_t high)
{
  same_length(4, loop.shape(0), "loop");
  same_length(2, loop.shape(1), "a factor of the loop");
  const auto factor = [&](size_t i) { return anhyst_factor{loop(i, 0), loop(i, 1)}; };
  Made drive(new FixedDrive);
  drive->current_ = drive->table(entries);
  drive->loop_ = {drive->table(wanted), factor(0), factor(1), factor(2), factor(3)};
  sound_drive(
      anhyst_drive_init_flux_q31(&drive->state_, &drive->current_, &drive->loop_, low, high));
  return drive;
}

void bind_drives(nb::module_ &m)
{
  bind_real<DriveF64>(m, "Drive");
  bind_real<DriveF32>(m, "SingleDrive");
  nb::class_<FixedDrive>(m, "FixedDrive")
      .def_static("map", &FixedDrive::map, "entries"_a.noconvert(), "low"_a, "high"_a)
      .def_static("compensator", &FixedDrive::compensator, "kind"_a, "words"_a.noconvert())
      .def_static("flux", &FixedDrive::flux, "entries"_a.noconvert(), "wanted"_a.noconvert(),
                  "loop"_a.noconvert(), "low"_a, "high"_a)
      .def("solve", &FixedDrive::solve, "demand"_a, "gap"_a, "flux"_a)
      .def("commit", &FixedDrive::commit, "applied"_a, "gap"_a)
      .def_prop_ro("flags", &FixedDrive::flags)
      .def("conditioning_length", &FixedDrive::conditioning_length)
      .def("conditioning", &FixedDrive::conditioning, "tick"_a);
}
