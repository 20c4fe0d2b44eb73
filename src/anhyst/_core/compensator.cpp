// SPDX-License-Identifier: Apache-2.0
// The fixed-point compensator in Python: the very functions that run on a controller.
#include <nanobind/stl/string.h>

#include <algorithm>
#include <vector>

#include "arrays.h"
#include "force_controllers.h"

const anhyst_kernel *to_kernel(const std::string &kind)
{
  if (kind == "full") {
    return &anhyst_kernel_full;
  }
  if (kind == "simplified") {
    return &anhyst_kernel_simplified;
  }
  if (kind == "euler") {
    return &anhyst_kernel_euler;
  }
  if (kind == "cells") {
    return &anhyst_kernel_cells;
  }
  throw std::invalid_argument("unknown kind of compensator: " + kind);
}

namespace {

using Words = nb::ndarray<const int16_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InQ = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using OutQ = nb::ndarray<nb::numpy, int32_t, nb::ndim<1>>;

OutQ make_words(size_t n)
{
  int32_t *data = new int32_t[n];
  nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<int32_t *>(p); });
  return OutQ(data, {n}, owner);
}

class Compensator {
public:
  Compensator(const std::string &kind, const Words &words)
      : words_(words.data(), words.data() + words.shape(0))
  {
    const anhyst_status status = anhyst_compensator_init(&state_, to_kernel(kind), words_.data(),
                                                         static_cast<uint16_t>(words_.size()));
    if (status != ANHYST_OK) {
      throw std::invalid_argument("the parameter block is not valid");
    }
  }
  Compensator(const Compensator &) = delete;
  Compensator &operator=(const Compensator &) = delete;

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
  int flags() const { return state_.flags; }

  void swap(const Words &words)
  {
    std::vector<int16_t> next(words.data(), words.data() + words.shape(0));
    if (anhyst_block_check(state_.kernel, next.data(), static_cast<uint16_t>(next.size())) !=
        ANHYST_OK) {
      throw std::invalid_argument("the parameter block is not valid");
    }
    words_.swap(next);
    anhyst_compensator_swap(&state_, words_.data());
  }

  // With the plays behind it where the law has them, and then all that for each deeper memory, with
  // what it is owed.
  OutQ memory() const
  {
    std::vector<int32_t> words;
    const auto put = [&](const anhyst_memory &m, const int32_t *plays) {
      words.insert(words.end(), m.number, m.number + 5);
      if (has_plays()) {
        words.insert(words.end(), plays, plays + ANHYST_CELLS);
      }
    };
    put(state_.memory, state_.plays);
    for (size_t i = 0; i < deeper(); i++) {
      put(state_.deeper[i].memory, state_.deeper[i].plays);
      words.push_back(state_.deeper[i].owed);
    }
    OutQ out = make_words(words.size());
    std::copy(words.begin(), words.end(), out.data());
    return out;
  }
  // Three words: what was before is not known, the play turns here.
  void set_memory(const InQ &words)
  {
    const size_t n = words.shape(0);
    if (has_plays()) {
      constexpr size_t each = 5 + ANHYST_CELLS;
      same_length(each + deeper() * (each + 1), n, "memory");
      const int32_t *at = words.data();
      const auto take = [&at](anhyst_memory &memory, int32_t *plays) {
        std::copy(at, at + 5, memory.number);
        std::copy(at + 5, at + each, plays);
        at += each;
      };
      take(state_.memory, state_.plays);
      for (size_t i = 0; i < deeper(); i++) {
        take(state_.deeper[i].memory, state_.deeper[i].plays);
        state_.deeper[i].owed = *at++;
      }
      state_.next.fine = 0;
      state_.solved = 0;
      return;
    }
    if (n != 3 && n != 5) {
      throw std::invalid_argument("a memory has five words, or three without the last turn");
    }
    const int32_t *w = words.data();
    if (anhyst_abs_q31(w[0]) > ANHYST_Q30_ONE || anhyst_abs_q31(w[1]) > ANHYST_Q30_ONE) {
      throw std::invalid_argument("a memory lies within -1..1 (q30)");
    }
    state_.memory = {{w[0], w[1], w[2], n == 5 ? w[3] : w[2], n == 5 ? w[4] : w[1]}};
    state_.solved = 0;
  }

  // A whole record: at every sample solve, and commit the solved current.
  OutQ run(const InQ &demand, const InQ &gap, bool q15)
  {
    same_length(demand.shape(0), gap.shape(0), "gap");
    OutQ out = make_words(demand.shape(0));
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

  int32_t conditioning_length() const { return anhyst_conditioning_length(&state_); }
  int16_t conditioning_q15(int32_t tick) const { return anhyst_conditioning_q15(&state_, tick); }

private:
  bool has_plays() const { return state_.kernel->keep != nullptr; }
  // Memories beyond the first.
  size_t deeper() const
  {
    const int layers = has_plays() ? words_[ANHYST_WORD_SOLID_LAYERS] : 0;
    return layers == 0 ? 0 : layers - (words_[ANHYST_WORD_SOLID_LAMINATED] > 0 ? 0 : 1);
  }

  std::vector<int16_t> words_;
  anhyst_compensator state_{};
};

} // namespace

void bind_compensator(nb::module_ &m)
{
  nb::class_<Compensator>(m, "FixedCompensator")
      .def(nb::init<const std::string &, const Words &>(), "kind"_a, "words"_a.noconvert())
      .def("solve_q31", &Compensator::solve_q31, "demand"_a, "gap"_a)
      .def("solve_q15", &Compensator::solve_q15, "demand"_a, "gap"_a)
      .def("commit_q31", &Compensator::commit_q31, "applied"_a, "gap"_a)
      .def("commit_q15", &Compensator::commit_q15, "applied"_a, "gap"_a)
      .def("output_q31", &Compensator::output_q31)
      .def("output_q15", &Compensator::output_q15)
      .def_prop_ro("flags", &Compensator::flags)
      .def("swap", &Compensator::swap, "words"_a.noconvert())
      .def_prop_ro("memory", &Compensator::memory, nb::rv_policy::move)
      .def("set_memory", &Compensator::set_memory, "words"_a.noconvert())
      .def("run", &Compensator::run, "demand"_a.noconvert(), "gap"_a.noconvert(), "q15"_a)
      .def("conditioning_length", &Compensator::conditioning_length)
      .def("conditioning_q15", &Compensator::conditioning_q15, "tick"_a);
}
