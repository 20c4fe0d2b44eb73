/* SPDX-License-Identifier: Apache-2.0 */
#ifndef NUCLEO_H
#define NUCLEO_H

#include "app/board.h"

/* Clocks of this board, derived from the 8 MHz of its ST-Link. */
#define CRYSTAL_HZ 8000000U /* external clock (bypass mode); the board has no crystal */
#define PLL_M 8U
#define PLL_N 332U /* 8 MHz/8*332/2 = 166 MHz: 921600 baud within 0.07 % */
#define PLL_Q 7U   /* divider that is not used; at least 2 */
#define PLL_R 2U   /* divider that is not used; at least 2 */
#define CORE_HZ (CRYSTAL_HZ / PLL_M * PLL_N / 2U)
#define APB1_HZ (CORE_HZ / 4U)
#define TIMER_HZ (2U * APB1_HZ) /* clock of timers 2 to 5 */

/* Constants of the board, from board_force.c or board_position.c. */
extern const app_board nucleo_board;

#endif
