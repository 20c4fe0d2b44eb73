/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law in fixed point, f32 and f64, with the same words. */
#ifndef TEST_CELL_LAW_FORMATS_H
#define TEST_CELL_LAW_FORMATS_H

#include "anhyst/compensator/compensator.h"
#include "anhyst/compensator/compensator_f32.h"
#include "anhyst/compensator/compensator_f64.h"

#include "cell_words.h"

static float words_f32[1024];
static double words_f64[1024];

/* Sets the floating-point words to the values of the fixed-point words. */
static inline void fill_real_words(void)
{
  for (int i = 0; i < 1024; i++) {
    words_f64[i] = word_as_number(i);
    words_f32[i] = (float)words_f64[i];
  }
}

#define LAW_FORMATS                                                                                \
  FORMAT(fixed, anhyst_compensator, anhyst_arms, anhyst_kernel_cells, int32_t, words,              \
         1073741824.0, weight_of)                                                                  \
  FORMAT(f32, anhyst_compensator_f32, anhyst_arms_f32, anhyst_kernel_cells_f32, float, words_f32,  \
         1.0, single_of)                                                                           \
  FORMAT(f64, anhyst_compensator_f64, anhyst_arms_f64, anhyst_kernel_cells_f64, double, words_f64, \
         1.0, double_of)
#include "law_formats.h"

#endif
