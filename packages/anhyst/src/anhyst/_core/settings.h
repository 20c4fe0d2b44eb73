// SPDX-License-Identifier: Apache-2.0
// Settings by name. A missing, unknown or wrongly typed setting is an error.
#pragma once

#include <set>
#include <stdexcept>
#include <string>

#include "arrays.h"

class Settings {
public:
  explicit Settings(const nb::dict &values) : values_(values) {}

  template <class T> T take(const std::string &name)
  {
    T value{};
    taken_.insert(name);
    if (!values_.contains(name.c_str())) {
      throw std::invalid_argument("setting '" + name + "' is missing");
    }
    if (!nb::try_cast<T>(values_[name.c_str()], value)) {
      throw std::invalid_argument("setting '" + name + "' is of the wrong type or out of range");
    }
    return value;
  }

  // Throws if a setting was not used. Call it after the last setting was read.
  void finish() const
  {
    for (const auto &[key, value] : values_) {
      const std::string name = nb::str(key).c_str();
      if (taken_.count(name) == 0) {
        throw std::invalid_argument("there is no setting '" + name + "'");
      }
    }
  }

private:
  nb::dict values_;
  std::set<std::string> taken_;
};
