// SPDX-License-Identifier: Apache-2.0
// The controller of a mass between two magnets that follows a set-point.
#include "anhyst_plant/tracking.h"

#include <vector>

#include "force_controllers.h"
#include "position.h"
#include "settings.h"

namespace {

anhyst_tracking_drive drive_of(nb::handle magnet, const anhyst_tracking_scales &scales)
{
  FixedForceController *fixed = nullptr;
  if (nb::try_cast<FixedForceController *>(magnet, fixed) && fixed) {
    return {fixed->get(), scales, anhyst_tracking_solve_q31, anhyst_tracking_commit_q31};
  }
  RealForceController<ForceControllerF64> *wide = nullptr;
  if (nb::try_cast<RealForceController<ForceControllerF64> *>(magnet, wide) && wide) {
    return {wide->get(), scales, anhyst_tracking_solve_f64, anhyst_tracking_commit_f64};
  }
  RealForceController<ForceControllerF32> *narrow = nullptr;
  if (nb::try_cast<RealForceController<ForceControllerF32> *>(magnet, narrow) && narrow) {
    return {narrow->get(), scales, anhyst_tracking_solve_f32, anhyst_tracking_commit_f32};
  }
  throw std::invalid_argument("each magnet has a force controller");
}

class Tracking : public LoopController {
public:
  Tracking(const nb::list &magnets, const nb::dict &settings)
  {
    Settings given(settings);
    const anhyst_tracking_scales scales = {
        given.take<double>("demand_full"), given.take<double>("current_full"),
        given.take<double>("flux_full"), given.take<double>("gap_low"),
        given.take<double>("gap_high")};
    state_.forward[0] = given.take<double>("b0");
    state_.forward[1] = given.take<double>("b1");
    state_.forward[2] = given.take<double>("b2");
    state_.back[0] = given.take<double>("a1");
    state_.back[1] = given.take<double>("a2");
    state_.idle = given.take<double>("idle");
    state_.by_halves = given.take<bool>("by_halves") ? 1 : 0;
    state_.gap_total = given.take<double>("gap_total");
    state_.current_low = given.take<double>("current_low");
    state_.current_high = given.take<double>("current_high");
    state_.current_step = given.take<double>("current_step");
    given.finish();
    if (magnets.size() != ANHYST_TRACKING_MAGNETS || magnets[0].is(magnets[1])) {
      throw std::invalid_argument("each of two magnets has a force controller of its own");
    }
    if (!(state_.idle > 0.0 && scales.demand > 0.0 && scales.current > 0.0 && scales.flux > 0.0 &&
          scales.gap_low < scales.gap_high)) {
      throw std::invalid_argument("the settings of the controller are not valid");
    }
    for (size_t i = 0; i < magnets.size(); i++) {
      magnets_.push_back(nb::borrow(magnets[i]));
      state_.drive[i] = drive_of(magnets[i], scales);
    }
  }

  anhyst_loop_controller handle() override { return {&state_, anhyst_tracking_tick}; }

private:
  std::vector<nb::object> magnets_;
  anhyst_tracking state_{};
};

nb::tuple allocate(double net, double idle)
{
  double force[ANHYST_TRACKING_MAGNETS];
  anhyst_tracking_allocate(net, idle, force);
  return nb::make_tuple(force[0], force[1]);
}

} // namespace

void bind_tracking(nb::module_ &m)
{
  nb::class_<Tracking, LoopController>(m, "Tracking")
      .def(nb::init<const nb::list &, const nb::dict &>(), "magnets"_a, "settings"_a);
  m.def("allocate", allocate, "net"_a, "idle"_a);
}
