/* SPDX-License-Identifier: Apache-2.0 */

/* Initialises a force controller with the method play. anhyst_play_map_init must have initialised
   the map, whose play is not reset. The map must live as long as the controller. */
void anhyst_force_controller_init_play_x(anhyst_force_controller_x *c, anhyst_play_map_x *play);
