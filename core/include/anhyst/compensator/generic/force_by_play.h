/* SPDX-License-Identifier: Apache-2.0 */

/* Initialises a force controller with the method `play`. The map must be initialised before by
   anhyst_play_map_init and live as long as the controller. The position of the play is kept. */
void anhyst_force_controller_init_play_x(anhyst_force_controller_x *c, anhyst_play_map_x *play);
