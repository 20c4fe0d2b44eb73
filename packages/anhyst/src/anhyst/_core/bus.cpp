// SPDX-License-Identifier: Apache-2.0
// A firmware in this process as the controller of a loop, and its answers.
#include "anhyst_plant/bus.h"

#include <vector>

#include "arrays.h"
#include "position.h"
#include "settings.h"

namespace {

using OutWords = nb::ndarray<nb::numpy, uint32_t, nb::ndim<2>>;

class Bus : public LoopController {
public:
  // Addresses of library_tick and of a controller's memory (library.h), valid until end().
  Bus(uintptr_t tick, uintptr_t firmware, const nb::dict &scales)
  {
    Settings from(scales);
    bus_.scales = {from.take<double>("gap_middle"),   from.take<double>("position_full"),
                   from.take<double>("current_full"), from.take<double>("demand_full"),
                   from.take<double>("load_full"),    from.take<double>("flux_full")};
    from.finish();
    bus_.firmware = reinterpret_cast<void *>(firmware);
    bus_.firmware_tick = reinterpret_cast<decltype(bus_.firmware_tick)>(tick);
  }

  anhyst_loop_controller handle() override { return {this, tick}; }

  void end() { bus_.firmware_tick = nullptr; }

  uint32_t last() const { return bus_.tick; }

  // Returns the answers since the last call, one row per tick.
  OutWords take_answers()
  {
    const size_t rows = answers_.size() / ANHYST_BUS_DRIVE_WORDS;
    auto *owned = new std::vector<uint32_t>(std::move(answers_));
    answers_ = {};
    nb::capsule owner(owned,
                      [](void *p) noexcept { delete static_cast<std::vector<uint32_t> *>(p); });
    return OutWords(owned->data(), {rows, ANHYST_BUS_DRIVE_WORDS}, owner);
  }

private:
  static void tick(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer)
  {
    Bus *bus = static_cast<Bus *>(self);
    anhyst_bus_controller_tick(&bus->bus_, sample, answer);
    if (!answer->gone) {
      bus->answers_.insert(bus->answers_.end(), std::begin(bus->bus_.drive),
                           std::end(bus->bus_.drive));
    }
  }

  anhyst_bus_controller bus_{};
  std::vector<uint32_t> answers_;
};

} // namespace

void bind_bus(nb::module_ &m)
{
  nb::class_<Bus, LoopController>(m, "BusController")
      .def(nb::init<uintptr_t, uintptr_t, const nb::dict &>(), "tick"_a, "firmware"_a, "scales"_a)
      .def("take", &Bus::take_answers)
      .def("end", &Bus::end)
      .def_prop_ro("tick", &Bus::last);
}
