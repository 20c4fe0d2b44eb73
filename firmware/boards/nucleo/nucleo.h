/* SPDX-License-Identifier: Apache-2.0 */
#ifndef NUCLEO_H
#define NUCLEO_H

#include "app/board.h"

/* Constants of the board, by the body that the firmware is built with: board_force.c. */
extern const app_board nucleo_board;

#endif
