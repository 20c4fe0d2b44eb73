// SPDX-License-Identifier: Apache-2.0
// The controllers of a levitating armature in Python, with the C functions of a real controller.
#include "position.h"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>

#include <array>
#include <vector>

#include "anhyst_plant/position.h"
#include "force_controllers.h"
#include "gains.h"
#include "settings.h"

namespace {

struct FixedFormat {
  using Number = int32_t;
  using Gains = GainsQ31;
  using ForceController = FixedForceController;
  using State = anhyst_position_q31;
  using Limits = anhyst_position_limits_q31;
  using Chosen = anhyst_position_settings_q31;
  using Adapter = anhyst_position_adapter_q31;
  static constexpr auto init = anhyst_position_init_q31;
  static constexpr auto tick = anhyst_position_adapter_tick_q31;

  static void read_units(Settings &from, Chosen &to, anhyst_position_scales &scales, size_t magnets)
  {
    for (size_t i = 0; i < magnets; i++) {
      const std::string which = std::to_string(i + 1);
      to.units.gap[i] = {
          from.take<int32_t>("gap_offset_" + which),
          {from.take<int16_t>("gap_mantissa_" + which), from.take<int16_t>("gap_shift_" + which)}};
    }
    scales = {from.take<double>("gap_middle"),   from.take<double>("position_full"),
              from.take<double>("current_full"), from.take<double>("demand_full"),
              from.take<double>("load_full"),    from.take<double>("flux_full")};
  }
};

template <class N> struct RealFormat {
  using Number = N;

  template <class Chosen>
  static void read_units(Settings &from, Chosen &to, anhyst_position_scales &scales, size_t magnets)
  {
    for (size_t i = 0; i < magnets; i++) {
      const std::string which = std::to_string(i + 1);
      to.units.gap[i] = {static_cast<N>(from.take<double>("gap_offset_" + which)),
                         static_cast<N>(from.take<double>("gap_factor_" + which))};
    }
    to.units.position = static_cast<N>(from.take<double>("position_full"));
    to.units.demand = static_cast<N>(from.take<double>("demand_full"));
    scales = {from.take<double>("gap_middle"), 1.0, 1.0, 1.0, 1.0, 1.0};
  }
};

#define POSITION(F, REAL, f)                                                                       \
  struct Format##F : RealFormat<REAL> {                                                            \
    using Gains = Gains##F;                                                                        \
    using ForceController = RealForceController<ForceController##F>;                               \
    using State = anhyst_position_##f;                                                             \
    using Limits = anhyst_position_limits_##f;                                                     \
    using Chosen = anhyst_position_settings_##f;                                                   \
    using Adapter = anhyst_position_adapter_##f;                                                   \
    static constexpr auto init = anhyst_position_init_##f;                                         \
    static constexpr auto tick = anhyst_position_adapter_tick_##f;                                 \
  }
POSITION(F64, double, f64);
POSITION(F32, float, f32);
#undef POSITION

anhyst_levitation_limits read_levitation_limits(Settings &from)
{
  return {from.take<int32_t>("position_low"),  from.take<int32_t>("position_high"),
          from.take<int32_t>("position_step"), from.take<uint16_t>("max_missing_samples"),
          from.take<uint16_t>("hold"),         from.take<uint16_t>("selftest")};
}

anhyst_levitation_settings read_levitation_settings(Settings &from)
{
  return {from.take<int32_t>("detect"),   from.take<int32_t>("rise"),
          from.take<int32_t>("descend"),  from.take<int32_t>("lift"),
          from.take<int32_t>("set_down"), from.take<int32_t>("most"),
          from.take<int32_t>("press")};
}

template <class F> class Position : public LoopController {
public:
  using Number = typename F::Number;

  Position(const typename F::Gains::row &gains, const nb::list &magnets, const nb::dict &settings)
  {
    if (magnets.size() != 1 && magnets.size() != 2) {
      throw std::invalid_argument(
          "a controller has one force controller, or two of a pair of magnets");
    }
    std::array<decltype(force_controller_state(magnets[0])), 2> states{};
    for (size_t i = 0; i < magnets.size(); i++) {
      magnets_.push_back(nb::borrow(magnets[i]));
      states[i] = force_controller_state(magnets[i]);
    }
    if (states[0] == states[1]) {
      throw std::invalid_argument("each magnet of a pair has a force controller of its own");
    }
    read_settings(gains, settings);
    if (F::init(&state_, &limits_, &chosen_, states[0], states[1]) != ANHYST_OK) {
      throw std::invalid_argument("the settings of the controller are not valid");
    }
    adapter_.position = &state_;
  }

  anhyst_loop_controller handle() override { return {&adapter_, F::tick}; }

  nb::tuple tick(double gap, double target, double load, std::pair<double, double> current,
                 std::pair<double, double> flux, uint32_t command)
  {
    const double currents[2] = {current.first, current.second};
    const double fluxes[2] = {flux.first, flux.second};
    const anhyst_loop_sample sample = {2,        1,      1,       &gap,  &gap,
                                       currents, fluxes, &target, &load, command};
    double driven[2];
    double reference = 0.0;
    double demand = 0.0;
    anhyst_loop_answer answer = {driven, &reference, &demand, 0, 0, 0};
    F::tick(&adapter_, &sample, &answer);
    return nb::make_tuple(driven[0], driven[1], reference, demand, answer.state, answer.flags);
  }

  int fault() const { return state_.levitation.supervisor.fault; }

private:
  static auto force_controller_state(nb::handle magnet)
  {
    typename F::ForceController *found = nullptr;
    if (!nb::try_cast<typename F::ForceController *>(magnet, found) || found == nullptr) {
      throw std::invalid_argument("each magnet has a force controller of this number format");
    }
    return found->get();
  }

  void read_settings(const typename F::Gains::row &gains, const nb::dict &settings)
  {
    Settings from(settings);
    const auto number = [&](const char *name) { return from.take<Wide>(name); };
    limits_.levitation = read_levitation_limits(from);
    limits_.current_low = static_cast<Number>(number("current_low"));
    limits_.current_high = static_cast<Number>(number("current_high"));
    limits_.current_step = static_cast<Number>(number("current_step"));
    limits_.release = static_cast<Number>(number("release"));
    chosen_.levitation = read_levitation_settings(from);
    chosen_.gains = valid_gains<typename F::Gains>(gains);
    chosen_.bias = static_cast<Number>(number("bias"));
    chosen_.measured = from.take<bool>("measured") ? 1 : 0;
    F::read_units(from, chosen_, adapter_.scales, magnets_.size());
    from.finish();
  }

  // Number type of values from Python, before they are rounded to the format.
  using Wide = std::conditional_t<std::is_integral_v<Number>, int32_t, double>;

  std::vector<nb::object> magnets_;
  typename F::Limits limits_{};
  typename F::Chosen chosen_{};
  typename F::State state_{};
  typename F::Adapter adapter_{};
};

template <class F> void bind(nb::module_ &m, const char *name)
{
  using Bound = Position<F>;
  const double none = std::numeric_limits<double>::quiet_NaN();
  nb::class_<Bound, LoopController>(m, name)
      .def(nb::init<const typename F::Gains::row &, const nb::list &, const nb::dict &>(),
           "gains"_a.noconvert(), "magnets"_a, "settings"_a)
      .def("tick", &Bound::tick, "gap"_a, "target"_a, "load"_a = 0.0,
           "current"_a = std::pair(0.0, 0.0), "flux"_a = std::pair(none, none), "command"_a = 0)
      .def_prop_ro("fault", &Bound::fault);
}

} // namespace

void bind_position(nb::module_ &m)
{
  m.attr("POSITION_MAGNETS") = ANHYST_POSITION_MAGNETS;
  nb::class_<LoopController>(m, "LoopController");
  bind<FormatF64>(m, "Position");
  bind<FormatF32>(m, "PositionF32");
  bind<FixedFormat>(m, "FixedPosition");
}
