/* SPDX-License-Identifier: Apache-2.0 */

/* The controller goes on with the play of a map that anhyst_play_map_init has made; it must live as
   long as the controller. */
void ANHYST_NAME(anhyst_force_controller_init_play)(ANHYST_NAME(anhyst_force_controller) *c,
                                                    ANHYST_NAME(anhyst_play_map) *play);
