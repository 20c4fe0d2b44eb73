/* SPDX-License-Identifier: Apache-2.0 */
/* Solid core: layers of one hysteresis law from the surface to the middle, coupled by diffusion. */
#ifndef ANHYST_LAYERS_H
#define ANHYST_LAYERS_H

#include "anhyst/law/circuit.h"

/* Returns the flux density, T, for an effective field and a magnetisation in units of the law. */
double anhyst_flux_from_f64(const anhyst_iron_f64 *iron, double x, double m);

/* Same as anhyst_forward_f64 and anhyst_inverse_f64, for iron with several layers. */
anhyst_status anhyst_layers_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                        const anhyst_circuit_f64 *circuit, double drive,
                                        anhyst_reaction_f64 *reaction);
anhyst_status anhyst_layers_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                        const anhyst_circuit_f64 *circuit, double flux,
                                        anhyst_reaction_f64 *reaction);

#endif
