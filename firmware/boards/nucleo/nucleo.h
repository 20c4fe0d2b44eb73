/* SPDX-License-Identifier: Apache-2.0 */
#ifndef NUCLEO_H
#define NUCLEO_H

#include "app/board.h"

/* The clocks of this board, from the 8 MHz of its ST-Link. */
#define CRYSTAL_HZ 8000000U /* not a crystal: bypass */
#define PLL_M 8U
#define PLL_N 332U /* 8 MHz/8*332/2 = 166 MHz: makes the 921600 baud good to 0.07 % */
#define PLL_Q 7U   /* not used; 2 or more */
#define PLL_R 2U   /* likewise */
#define CORE_HZ (CRYSTAL_HZ / PLL_M * PLL_N / 2U)
#define APB1_HZ (CORE_HZ / 4U)
#define TIMER_HZ (2U * APB1_HZ) /* of the timers on APB1: 2 to 5 */

/* Constants of the board, by the body that the firmware is built with: board_force.c. */
extern const app_board nucleo_board;

#endif
