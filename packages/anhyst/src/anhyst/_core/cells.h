// SPDX-License-Identifier: Apache-2.0
// Play cells, together with their tables.
#pragma once

#include <nanobind/stl/optional.h>

#include <optional>
#include <vector>

#include "anhyst/law/cells.h"
#include "arrays.h"

class Cells {
public:
  Cells(const In &thresholds, const In &widths, const InTable &weights, const std::string &shape,
        const std::optional<In> &centres, double aim = ANHYST_CELLS_AIM)
  {
    same_shape(thresholds.shape(0), widths.shape(0), weights, "weights");
    if (shape != "tanh" && shape != "langevin") {
      throw std::invalid_argument("unknown shape of play cells: " + shape);
    }
    thresholds_.assign(thresholds.data(), thresholds.data() + thresholds.size());
    widths_.assign(widths.data(), widths.data() + widths.size());
    weights_.assign(weights.data(), weights.data() + weights.size());
    if (centres) {
      same_length(widths.shape(0), centres->shape(0), "centres");
      centres_.assign(centres->data(), centres->data() + centres->size());
    }
    given_ = {static_cast<int>(thresholds_.size()),
              static_cast<int>(widths_.size()),
              thresholds_.data(),
              widths_.data(),
              weights_.data(),
              shape == "tanh" ? ANHYST_SHAPE_TANH : ANHYST_SHAPE_LANGEVIN,
              centres ? centres_.data() : nullptr};
    size_t pieces = 0;
    if (thresholds.shape(0) < 1 || thresholds.shape(0) > ANHYST_CELLS_MAX || widths.shape(0) < 1 ||
        anhyst_cells_lay_f64(&cells_, &given_, aim, &pieces) != ANHYST_OK) {
      throw std::invalid_argument(
          "play cells out of range: 1 to 64 thresholds that ascend from 0, widths above 0, weights "
          "and centres of 0 and above, one weight above 0, no width below about 1/300 of a "
          "threshold");
    }
    rows_.resize(pieces);
    anhyst_cells_tabulate_f64(&cells_, &given_, rows_.data());
  }

  const anhyst_cells_f64 *get() const { return &cells_; }
  const anhyst_cell_weights_f64 *weights() const { return &given_; }

private:
  Cells(const Cells &) = delete;
  Cells &operator=(const Cells &) = delete;

  std::vector<double> thresholds_, widths_, weights_, centres_;
  anhyst_cell_weights_f64 given_{};
  std::vector<anhyst_cell_piece_f64> rows_;
  anhyst_cells_f64 cells_{};
};
