// SPDX-License-Identifier: Apache-2.0
// A controller at the other end of the plant bus: a firmware in this process, and what it answered.
#include "anhyst_plant/bus.h"

#include <vector>

#include "arrays.h"
#include "position.h"
#include "settings.h"

namespace {

using OutWords = nb::ndarray<nb::numpy, uint32_t, nb::ndim<2>>;

// library_tick of firmware/boards/library/library.h
using Tick = void (*)(const uint8_t *sample, uint8_t *drive);

class Bus : public LoopController {
public:
  // The address is that of the firmware's library_tick; it stays loaded until end().
  Bus(uintptr_t address, const nb::dict &scales) : firmware_(reinterpret_cast<Tick>(address))
  {
    Settings from(scales);
    bus_.scales = {from.take<double>("gap_middle"),   from.take<double>("position_full"),
                   from.take<double>("current_full"), from.take<double>("demand_full"),
                   from.take<double>("load_full"),    from.take<double>("flux_full")};
    from.finish();
    bus_.line = this;
    bus_.exchange = [](void *line, const uint8_t *sample, uint8_t *drive) {
      const Tick firmware = static_cast<Bus *>(line)->firmware_;
      return firmware != nullptr ? (firmware(sample, drive), 1) : 0;
    };
  }

  anhyst_loop_controller handle() override { return {this, tick}; }

  void end() { firmware_ = nullptr; }

  uint32_t last() const { return bus_.tick; }

  // The answers since the last time, a row a tick.
  OutWords take()
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

  Tick firmware_;
  anhyst_bus_controller bus_{};
  std::vector<uint32_t> answers_;
};

} // namespace

void bind_bus(nb::module_ &m)
{
  nb::class_<Bus, LoopController>(m, "BusController")
      .def(nb::init<uintptr_t, const nb::dict &>(), "address"_a, "scales"_a)
      .def("take", &Bus::take)
      .def("end", &Bus::end)
      .def_prop_ro("tick", &Bus::last);
}
