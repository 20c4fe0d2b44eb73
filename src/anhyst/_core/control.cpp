// SPDX-License-Identifier: Apache-2.0
// The position controller in Python, in every format: the very functions that run on a controller.
#include <array>

#include "anhyst/pidd2.h"
#include "anhyst/pidd2_real.h"
#include "arrays.h"

namespace {

using Words = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

[[noreturn]] void refuse() { throw std::invalid_argument("a gain is out of its range"); }

struct Q31 {
  using number = int32_t;
  using row = Words;
  using gains = anhyst_pidd2_gains_q31;
  using state = anhyst_pidd2_state_q31;
  using candidate = anhyst_pidd2_candidate_q31;
  static constexpr auto check = anhyst_pidd2_check_q31;
  static constexpr auto start = anhyst_pidd2_start_q31;
  static constexpr auto solve = anhyst_pidd2_solve_q31;
  static constexpr auto commit = anhyst_pidd2_commit_q31;
  static constexpr auto change = anhyst_pidd2_change_q31;

  static gains read(const row &words)
  {
    same_length(19, words.shape(0), "gains");
    std::array<anhyst_factor, 8> f;
    for (size_t i = 0; i < f.size(); i++) {
      f[i] = {half(words(2 * i)), half(words(2 * i + 1))};
    }
    return {f[0], f[1],      f[2],     f[3], f[4], f[5], f[6], f[7], half(words(16)),
            0,    words(17), words(18)};
  }

private:
  static int16_t half(int32_t word)
  {
    if (word < INT16_MIN || word > INT16_MAX) {
      refuse();
    }
    return static_cast<int16_t>(word);
  }
};

template <class Number, class Gains, class State, class Candidate> struct Real {
  using number = Number;
  using row = In;
  using gains = Gains;
  using state = State;
  using candidate = Candidate;

  static gains read(const row &values)
  {
    same_length(11, values.shape(0), "gains");
    std::array<Number, 11> v;
    for (size_t i = 0; i < v.size(); i++) {
      v[i] = static_cast<Number>(values(i));
    }
    return {v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10]};
  }
};

struct F64
    : Real<double, anhyst_pidd2_gains_f64, anhyst_pidd2_state_f64, anhyst_pidd2_candidate_f64> {
  static constexpr auto check = anhyst_pidd2_check_f64;
  static constexpr auto start = anhyst_pidd2_start_f64;
  static constexpr auto solve = anhyst_pidd2_solve_f64;
  static constexpr auto commit = anhyst_pidd2_commit_f64;
  static constexpr auto change = anhyst_pidd2_change_f64;
};

struct F32
    : Real<float, anhyst_pidd2_gains_f32, anhyst_pidd2_state_f32, anhyst_pidd2_candidate_f32> {
  static constexpr auto check = anhyst_pidd2_check_f32;
  static constexpr auto start = anhyst_pidd2_start_f32;
  static constexpr auto solve = anhyst_pidd2_solve_f32;
  static constexpr auto commit = anhyst_pidd2_commit_f32;
  static constexpr auto change = anhyst_pidd2_change_f32;
};

template <class Format> class Controller {
public:
  using number = typename Format::number;

  explicit Controller(const typename Format::row &gains) : gains_(checked(gains)) {}

  void start(number reference, number position, number load, number output)
  {
    Format::start(&gains_, &state_, reference, position, load, output);
  }

  number solve(number reference, number position, number load)
  {
    return Format::solve(&gains_, &state_, reference, position, load, &candidate_);
  }

  void commit(number applied) { Format::commit(&gains_, &state_, &candidate_, applied); }

  void change(const typename Format::row &gains, number reference, number position, number load)
  {
    const typename Format::gains to = checked(gains);
    Format::change(&gains_, &to, &state_, reference, position, load);
    gains_ = to;
  }

  number wanted() const { return candidate_.wanted; }

  nb::tuple state() const
  {
    return nb::make_tuple(state_.position, state_.velocity, state_.integral);
  }

private:
  static typename Format::gains checked(const typename Format::row &row)
  {
    const typename Format::gains gains = Format::read(row);
    if (Format::check(&gains) != ANHYST_OK) {
      refuse();
    }
    return gains;
  }

  typename Format::gains gains_;
  typename Format::state state_{};
  typename Format::candidate candidate_{};
};

template <class Format> void bind(nb::module_ &m, const char *name)
{
  using Bound = Controller<Format>;
  nb::class_<Bound>(m, name)
      .def(nb::init<const typename Format::row &>(), "gains"_a.noconvert())
      .def("start", &Bound::start, "reference"_a, "position"_a, "load"_a, "output"_a)
      .def("solve", &Bound::solve, "reference"_a, "position"_a, "load"_a)
      .def("commit", &Bound::commit, "applied"_a)
      .def("change", &Bound::change, "gains"_a.noconvert(), "reference"_a, "position"_a, "load"_a)
      .def_prop_ro("wanted", &Bound::wanted)
      .def_prop_ro("state", &Bound::state);
}

} // namespace

void bind_control(nb::module_ &m)
{
  bind<Q31>(m, "FixedController");
  bind<F64>(m, "Controller");
  bind<F32>(m, "SingleController");
}
