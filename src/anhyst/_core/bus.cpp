// SPDX-License-Identifier: Apache-2.0
// A controller at the other end of the plant bus: a socket, and what came over it.
#include "anhyst_plant/bus.h"

#include <sys/socket.h>

#include <vector>

#include "arrays.h"
#include "position.h"
#include "settings.h"

namespace {

using OutWords = nb::ndarray<nb::numpy, uint32_t, nb::ndim<2>>;

// Waits inside the system, for as long as the socket's own time limits say.
bool transfer(int socket, const uint8_t *sample, uint8_t *drive)
{
  size_t done = 0;
  while (done < ANHYST_BUS_SAMPLE_BYTES) {
    const ssize_t taken = send(socket, sample + done, ANHYST_BUS_SAMPLE_BYTES - done, MSG_NOSIGNAL);
    if (taken <= 0) {
      return false;
    }
    done += static_cast<size_t>(taken);
  }
  return recv(socket, drive, ANHYST_BUS_DRIVE_BYTES, MSG_WAITALL) == ANHYST_BUS_DRIVE_BYTES;
}

class Bus : public LoopController {
public:
  Bus(int socket, const nb::dict &scales) : socket_(socket)
  {
    Settings from(scales);
    bus_.scales = {from.take<double>("gap_middle"),   from.take<double>("position_full"),
                   from.take<double>("current_full"), from.take<double>("demand_full"),
                   from.take<double>("load_full"),    from.take<double>("flux_full")};
    from.finish();
    bus_.line = this;
    bus_.exchange = [](void *line, const uint8_t *sample, uint8_t *drive) {
      return transfer(static_cast<Bus *>(line)->socket_, sample, drive) ? 1 : 0;
    };
  }

  anhyst_loop_controller handle() override { return {this, tick}; }

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

  int socket_;
  anhyst_bus_controller bus_{};
  std::vector<uint32_t> answers_;
};

} // namespace

void bind_bus(nb::module_ &m)
{
  nb::class_<Bus, LoopController>(m, "BusController")
      .def(nb::init<int, const nb::dict &>(), "socket"_a, "scales"_a)
      .def("take", &Bus::take)
      .def_prop_ro("tick", &Bus::last);
}
