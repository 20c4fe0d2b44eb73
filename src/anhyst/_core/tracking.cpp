// SPDX-License-Identifier: Apache-2.0
// The controller of a mass between two magnets that follows a set-point, in every format: the very
// functions that run on a controller.
#include "tracking.h"

#include "position.h"

namespace {

template <class F> class Tracking : public LoopController {
public:
  Tracking(const nb::list &magnets, const typename F::Row &pid, const nb::dict &settings)
  {
    Settings given(settings);
    adapter_.scales = take_scales(given);
    adapter_.gap_total = given.take<double>("gap_total");
    if (magnets.empty() || magnets.size() > ANHYST_TRACKING_MOST_DRIVES) {
      throw std::invalid_argument("a controller has 1 to 16 magnets");
    }
    law_.start(magnets, nb::list(), F::pid(pid), given, adapter_.scales);
    given.finish();
    adapter_.tracking = law_.get();
  }

  anhyst_loop_controller handle() override { return {&adapter_, F::tick}; }

private:
  TrackingLaw<F> law_;
  typename F::Adapter adapter_{};
};

template <class F> void bind(nb::module_ &m, const char *name)
{
  nb::class_<Tracking<F>, LoopController>(m, name).def(
      nb::init<const nb::list &, const typename F::Row &, const nb::dict &>(), "magnets"_a,
      "pid"_a.noconvert(), "settings"_a);
}

nb::tuple allocate(double net, double idle)
{
  const anhyst_allocation_f64 allocation = {idle, ANHYST_ALLOCATE_CLASS_AB};
  double force[2];
  anhyst_allocate_f64(&allocation, net, force);
  return nb::make_tuple(force[0], force[1]);
}

} // namespace

void bind_tracking(nb::module_ &m)
{
  bind<TrackingF64>(m, "Tracking");
  bind<TrackingF32>(m, "TrackingF32");
  bind<TrackingQ31>(m, "FixedTracking");
  m.def("allocate", allocate, "net"_a, "idle"_a);
}
