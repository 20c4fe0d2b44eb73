// SPDX-License-Identifier: Apache-2.0
// The compensator in Python, in each number format, with the C functions of a real controller.
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "formats.h"

namespace {

template <class T> using Row = nb::ndarray<nb::numpy, T, nb::ndim<1>>;
template <class T> using InRow = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T> Row<T> make_row(size_t n)
{
  T *data = new T[n];
  nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
  return Row<T>(data, {n}, owner);
}

// Base class of all formats. Shown is the number type of states and records in Python.
template <class F, class Shown> class Base {
public:
  Base(const std::string &kind, const Words<F> &words)
      : words_(words.data(), words.data() + words.shape(0))
  {
    const anhyst_status status =
        F::init(&state_, sizeof state_, to_kernel<F>(kind), words_.data(), size_of(words_));
    if (status != ANHYST_OK) {
      throw std::invalid_argument("the parameter block is not valid");
    }
  }
  Base(const Base &) = delete;
  Base &operator=(const Base &) = delete;

  int flags() const { return state_.flags; }
  int32_t conditioning_length() const { return F::conditioning_length(&state_); }

  void swap(const Words<F> &words)
  {
    std::vector<typename F::Entry> next(words.data(), words.data() + words.shape(0));
    if (F::check(state_.kernel, next.data(), size_of(next)) != ANHYST_OK) {
      throw std::invalid_argument("the parameter block is not valid");
    }
    F::swap(&state_, next.data());
    words_.swap(next);
  }

  // Returns five values, followed by the play positions if the law has plays.
  // Each deeper layer adds the same values and the flux deficit of its diffusion.
  Row<Shown> memory() const
  {
    std::vector<Shown> shown;
    put(shown, state_.memory, state_.plays);
    for (size_t i = 0; i < deeper(); i++) {
      put(shown, state_.deeper[i].memory, state_.deeper[i].plays);
      shown.push_back(static_cast<Shown>(state_.deeper[i].flux_deficit));
    }
    Row<Shown> out = make_row<Shown>(shown.size());
    std::copy(shown.begin(), shown.end(), out.data());
    return out;
  }

  // For a law without plays, three values are also accepted.
  // The last reversal is then unknown, and the present point counts as a reversal.
  void set_memory(const InRow<Shown> &shown)
  {
    const Shown *at = shown.data();
    const size_t n = shown.shape(0);
    if (has_plays()) {
      constexpr size_t each = 5 + ANHYST_CELLS;
      same_length(each + deeper() * (each + 1), n, "memory");
      read_memory(at, state_.memory, state_.plays);
      for (size_t i = 0; i < deeper(); i++) {
        read_memory(at, state_.deeper[i].memory, state_.deeper[i].plays);
        state_.deeper[i].flux_deficit = static_cast<Number>(*at++);
      }
    } else {
      if (n != 3 && n != 5) {
        throw std::invalid_argument("a memory has five numbers, or three without the last turn");
      }
      if (!(is_level(at[0]) && is_level(at[1]))) {
        throw std::invalid_argument("field or flux and level of a memory lie within -1..1");
      }
      const Shown five[] = {at[0], at[1], at[2], n == 5 ? at[3] : at[2], n == 5 ? at[4] : at[1]};
      for (size_t i = 0; i < 5; i++) {
        number(state_.memory, i) = static_cast<Number>(five[i]);
      }
    }
    state_.stage = ANHYST_STAGE_UNKNOWN;
  }

protected:
  using Number = typename F::Number;

  typename F::Compensator state_{};

private:
  static typename F::Size size_of(const std::vector<typename F::Entry> &words)
  {
    return static_cast<typename F::Size>(words.size());
  }
  bool has_plays() const { return state_.kernel->keep != nullptr; }
  // Returns the number of layers below the surface layer.
  size_t deeper() const
  {
    const int layers = has_plays() ? static_cast<int>(words_[ANHYST_WORD_SOLID_LAYERS]) : 0;
    return layers == 0 ? 0 : layers - (words_[ANHYST_WORD_SOLID_LAMINATED] > 0 ? 0 : 1);
  }
  static bool is_level(Shown a)
  {
    constexpr Shown one = std::is_same_v<F, Fixed> ? static_cast<Shown>(ANHYST_Q30_ONE) : 1;
    return a >= -one && a <= one;
  }
  // Returns a value of the state of a law without plays, by its index.
  static Number &number(typename F::Memory &memory, size_t i)
  {
    auto &full = memory.full;
    Number *const numbers[] = {&full.x, &full.y, &full.p, &full.reversal_play, &full.reversal_y};
    return *numbers[i];
  }
  void put(std::vector<Shown> &shown, const typename F::Memory &memory, const Number *plays) const
  {
    if (has_plays()) {
      const auto &cells = memory.cells;
      for (const auto each :
           {static_cast<Shown>(cells.x), static_cast<Shown>(cells.resting_m),
            static_cast<Shown>(cells.active), static_cast<Shown>(cells.stopped_on_rise),
            static_cast<Shown>(cells.last_activation)}) {
        shown.push_back(each);
      }
      shown.insert(shown.end(), plays, plays + ANHYST_CELLS);
      return;
    }
    typename F::Memory copy = memory;
    for (size_t i = 0; i < 5; i++) {
      shown.push_back(static_cast<Shown>(number(copy, i)));
    }
  }
  static int32_t to_integer(Shown a)
  {
    constexpr double most = 1e9;
    const double value = static_cast<double>(a);
    return static_cast<int32_t>(std::isnan(value) ? 0.0 : std::clamp(value, -most, most));
  }
  static void read_memory(const Shown *&at, typename F::Memory &memory, Number *plays)
  {
    memory.cells = {static_cast<Number>(at[0]), static_cast<Number>(at[1]), to_integer(at[2]),
                    to_integer(at[3]), static_cast<Number>(at[4])};
    std::transform(at + 5, at + 5 + ANHYST_CELLS, plays,
                   [](Shown a) { return static_cast<Number>(a); });
    at += 5 + ANHYST_CELLS;
  }

  std::vector<typename F::Entry> words_;
};

class FixedCompensator : public Base<Fixed, int32_t> {
public:
  using Base::Base;

  int32_t solve_q31(int32_t demand, int32_t gap)
  {
    return anhyst_compensator_solve_q31(&state_, demand, gap);
  }
  int16_t solve_q15(int16_t demand, int16_t gap)
  {
    return anhyst_compensator_solve_q15(&state_, demand, gap);
  }
  void commit_q31(int32_t applied, int32_t gap)
  {
    anhyst_compensator_commit_q31(&state_, applied, gap);
  }
  void commit_q15(int16_t applied, int16_t gap)
  {
    anhyst_compensator_commit_q15(&state_, applied, gap);
  }
  int32_t output_q31() const { return anhyst_compensator_output_q31(&state_); }
  int16_t output_q15() const { return anhyst_compensator_output_q15(&state_); }
  int16_t conditioning_q15(int32_t tick) const { return anhyst_conditioning_q15(&state_, tick); }

  // Computes a whole record: at each sample it solves, and commits the solved current.
  Row<int32_t> run(const InRow<int32_t> &demand, const InRow<int32_t> &gap, bool q15)
  {
    same_length(demand.shape(0), gap.shape(0), "gap");
    Row<int32_t> out = make_row<int32_t>(demand.shape(0));
    nb::gil_scoped_release release;
    for (size_t i = 0; i < demand.shape(0); i++) {
      const int32_t at = gap.data()[i];
      if (q15) {
        const int16_t current =
            solve_q15(static_cast<int16_t>(demand.data()[i]), static_cast<int16_t>(at));
        commit_q15(current, static_cast<int16_t>(at));
        out.data()[i] = current;
      } else {
        out.data()[i] = solve_q31(demand.data()[i], at);
        commit_q31(out.data()[i], at);
      }
    }
    return out;
  }
};

// Defines the compensator NAME for the format F; f is the suffix of its C functions.
#define REAL_COMPENSATOR(NAME, F, f)                                                               \
  class NAME : public Base<F, double> {                                                            \
  public:                                                                                          \
    using Base::Base;                                                                              \
    using Real = F::Number;                                                                        \
    static Real real(double a) { return static_cast<Real>(a); }                                    \
    Real solve(double demand, double gap)                                                          \
    {                                                                                              \
      return anhyst_compensator_solve##f(&state_, real(demand), real(gap));                        \
    }                                                                                              \
    void commit(double applied, double gap)                                                        \
    {                                                                                              \
      anhyst_compensator_commit##f(&state_, real(applied), real(gap));                             \
    }                                                                                              \
    Real output() const { return anhyst_compensator_output##f(&state_); }                          \
    Real conditioning(int32_t tick) const { return anhyst_conditioning##f(&state_, tick); }        \
  }
REAL_COMPENSATOR(CompensatorF32, F32, _f32);
REAL_COMPENSATOR(CompensatorF64, F64, _f64);
#undef REAL_COMPENSATOR

// Computes a whole record: at each sample it solves, and commits the solved current.
template <class C> Out run(C &compensator, const In &demand, const In &gap)
{
  same_length(demand.shape(0), gap.shape(0), "gap");
  Out out = make_array(demand.shape(0));
  nb::gil_scoped_release release;
  for (size_t i = 0; i < demand.shape(0); i++) {
    const auto current = compensator.solve(demand(i), gap(i));
    compensator.commit(current, gap(i));
    out.data()[i] = current;
  }
  return out;
}

template <class C, class F> nb::class_<C> bind(nb::module_ &m, const char *name)
{
  return nb::class_<C>(m, name)
      .def(nb::init<const std::string &, const Words<F> &>(), "kind"_a, "words"_a.noconvert())
      .def_prop_ro("flags", &C::flags)
      .def("swap", &C::swap, "words"_a.noconvert())
      .def_prop_ro("memory", &C::memory, nb::rv_policy::move)
      .def("set_memory", &C::set_memory, "values"_a.noconvert())
      .def("conditioning_length", &C::conditioning_length);
}

template <class C, class F> void bind_real(nb::module_ &m, const char *name)
{
  bind<C, F>(m, name)
      .def("solve", &C::solve, "demand"_a, "gap"_a)
      .def("commit", &C::commit, "applied"_a, "gap"_a)
      .def("output", &C::output)
      .def("run", &run<C>, "demand"_a.noconvert(), "gap"_a.noconvert())
      .def("conditioning", &C::conditioning, "tick"_a);
}

} // namespace

void bind_compensator(nb::module_ &m)
{
  bind<FixedCompensator, Fixed>(m, "FixedCompensator")
      .def("solve_q31", &FixedCompensator::solve_q31, "demand"_a, "gap"_a)
      .def("solve_q15", &FixedCompensator::solve_q15, "demand"_a, "gap"_a)
      .def("commit_q31", &FixedCompensator::commit_q31, "applied"_a, "gap"_a)
      .def("commit_q15", &FixedCompensator::commit_q15, "applied"_a, "gap"_a)
      .def("output_q31", &FixedCompensator::output_q31)
      .def("output_q15", &FixedCompensator::output_q15)
      .def("run", &FixedCompensator::run, "demand"_a.noconvert(), "gap"_a.noconvert(), "q15"_a)
      .def("conditioning_q15", &FixedCompensator::conditioning_q15, "tick"_a);
  bind_real<CompensatorF64, F64>(m, "Compensator");
  bind_real<CompensatorF32, F32>(m, "CompensatorF32");
}
