/* SPDX-License-Identifier: Apache-2.0 */

/* The controller goes on with the play of a map that anhyst_play_map_init has made; it must live as
   long as the controller. */
void anhyst_force_controller_init_play_x(anhyst_force_controller_x *c, anhyst_play_map_x *play);
