/* SPDX-License-Identifier: Apache-2.0 */
/* Names of coil_flux.h that end with the number format, as in names.h. They have a file of their
   own because every proof reads names.h. */
#ifndef ANHYST_NAMES_COIL_H
#define ANHYST_NAMES_COIL_H

#define anhyst_coil_flux_x ANHYST_NAME(anhyst_coil_flux)
#define anhyst_coil_flux_settings_x ANHYST_NAME(anhyst_coil_flux_settings)
#define anhyst_coil_sum_x ANHYST_NAME(anhyst_coil_sum)
#define anhyst_force_controller_init_coil_x ANHYST_NAME(anhyst_force_controller_init_coil)

#endif
