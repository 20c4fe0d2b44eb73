/* SPDX-License-Identifier: Apache-2.0 */
/* An electromagnet at a gap: winding, iron, pull; of two kinds.

   circuit: an iron in series with two gaps that fringe and a leakage path beside them, and with the
   joints of the core.
   Part of the path may be solid (solid.h); then H is the mean along it, B that over the section.
   Flux linkage and pull belong to one circuit, so that energy is kept:

     turns*current = length*H + eddy*length*dB/dt + outer(gap)*area*B,   psi = turns*area*B
     pull = (gap flux)^2/2 * d(gap reluctance)/d(gap)

   A circuit with a bias, as a voice coil in an iron core, has no gap that changes its reluctance: a
   magnet's own flux makes a force in proportion to the flux, in both directions, and drives the
   circuit as the body moves by x towards the force. Energy is kept here too:

     turns*current + bias*x = length*H + eddy*length*dB/dt + joints*area*B
     force = bias*area*B - spring*x,   x = middle - gap

   A circuit with a cone (cone.c) has that in place of the gaps, in series with its joints: the
   sliding clearance of a solenoid's plunger.

   law: an identified model. The pull comes from the law, c_H*(I - I_0) through rho(gap) to B and
   c_out*B^2 + F_0; the flux linkage from a table psi(I, gap), odd in I.

   The flux linkage moves by the trapezoidal rule, dpsi/dt = u - resistance*current: second order,
   stable for any step, and the iron turns round exactly where a voltage that jumps between two
   steps makes it. Both kinds are one equation with a rising left side. */
#ifndef ANHYST_PLANT_MAGNET_H
#define ANHYST_PLANT_MAGNET_H

#include "anhyst/law/circuit.h"
#include "anhyst_plant/iron.h"
#include "anhyst_plant/solid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The working gap of a solenoid: a plunger in front of a stop with a control cone. Three ways lie
   in parallel: its flat face, the wall of the cone, into which it dips and whose thin end
   saturates, and leakage that pulls at nothing. At ampere-turns u

     flux(u) = (face + leakage)*u + cone*u/sqrt(1 + (cone*u/limit)^2)

   and the pull is what the coenergy, the integral of the flux over u, loses for each metre. */
typedef struct {
  double leakage;    /* permeance parallel to the working gap, H */
  double side;       /* of a square as large as the flat face, m */
  double fringe;     /* by which this widens on each side, over the gap */
  double around;     /* circumference of the wall, m */
  double clearance;  /* radial, between plunger and wall, m */
  double depth;      /* gap at which the plunger begins to dip in, m */
  double onset;      /* length over which this beginning is washed out, m */
  double thickness;  /* of the wall at its end, m */
  double taper;      /* how much thicker it is for each metre of depth */
  double saturation; /* flux density at which the wall saturates, T */
} anhyst_plant_cone;

/* At one gap: permeances, H, and what they change by for each metre. */
typedef struct {
  double gap;      /* m */
  double straight; /* of face and leakage together */
  double d_face;
  double cone;
  double d_cone;
  double limit; /* flux that saturates the wall, Wb */
  double d_limit;
} anhyst_plant_cone_gap;

void anhyst_plant_cone_at(const anhyst_plant_cone *cone, double gap, anhyst_plant_cone_gap *at);

/* Ampere-turns that a flux needs, looked for from some near by, A; and their slope over the flux,
   1/H. */
double anhyst_plant_cone_mmf(const anhyst_plant_cone_gap *at, double flux, double near,
                             double *slope);

/* Pull that closes the gap, N. */
double anhyst_plant_cone_force(const anhyst_plant_cone_gap *at, double mmf);

typedef struct {
  anhyst_plant_iron iron;
  double iron_length; /* m */
  double iron_area;   /* m^2 */
  double pole_width;  /* m */
  double pole_depth;  /* m */
  double leakage;     /* permeance parallel to the gaps, H */
  double joints;      /* reluctance of air in the core, in series with all of it, 1/H */
  double eddy;        /* field that opposes a change of flux density, A s/(m T) */
  double bias;        /* magnetomotive force for each m moved, A/m; 0: the gaps pull */
  double middle;      /* gap where that is none, m */
  double spring;      /* force against the motion that no flux of the circuit makes, N/m */
  const anhyst_plant_solid *solid; /* null: all of it is sheets; with a cone it is */
  const anhyst_plant_cone *cone;   /* null: two gaps */
} anhyst_plant_circuit;

/* How a model's drive and output are made up at one gap. */
typedef struct {
  double drive;     /* c_H, 1/m */
  double gap_ratio; /* rho */
  double gain;      /* c_out, N/T^2 */
  double offset;    /* output at no flux, N */
  double zero;      /* current at no drive, A */
  double density;   /* flux density in the gap for that of the law, which is a choice of gauge */
} anhyst_plant_row;

/* Flux linkage over current (0..current_high, equal steps) and gap (equal steps), rising along the
   current; linear between, odd in the current, gone on with beyond. */
typedef struct {
  const double *psi; /* gaps rows of currents entries, Wb */
  int currents;      /* >= 2 */
  int gaps;          /* >= 2 */
  double current_high;
  double gap_low;
  double gap_high;
} anhyst_plant_flux_table;

typedef struct {
  const anhyst_iron_f64 *iron;
  const anhyst_plant_row *rows; /* over the gaps of the table: equal steps, linear between */
  int row_count;                /* >= 2 */
  double eddy;                  /* gamma, A s/(m T) */
  anhyst_plant_flux_table table;
} anhyst_plant_law;

typedef struct {
  const anhyst_plant_circuit *circuit; /* one of the two, the other null */
  const anhyst_plant_law *law;
  double turns;
  double resistance; /* ohm */
} anhyst_plant_magnet;

/* What drives the winding over one step: u = gain*(reference - current) + integral + voltage,
   within limits; beyond them the integral stands still. gain and reset 0 are a voltage. */
typedef struct {
  double reference; /* A */
  double gain;      /* V/A, >= 0 */
  double reset;     /* by which the integral follows reference - current, V/(A s) */
  double voltage;   /* V */
  double limit;     /* largest |u|, V */
} anhyst_plant_source;

/* All zero: demagnetised, no current. */
typedef struct {
  anhyst_plant_memory iron;    /* of a circuit, of its sheets */
  anhyst_plant_memory *volume; /* of its solid iron, the surface first; the caller's */
  anhyst_memory_f64 law;
  double over;     /* cone: ampere-turns over the gap, A */
  double stride;   /* law: by which the flux density moved last, T */
  double psi;      /* flux linkage, Wb */
  double current;  /* A */
  double steady;   /* current without that of the eddies in the iron, A */
  double voltage;  /* V */
  double integral; /* of the source, V */
  double force;    /* pull, N */
  double density;  /* flux density in the gap, T */
  double heat;     /* given to the winding's resistance so far, J */
  double energy;   /* taken from the amplifier so far, J */
} anhyst_plant_coil;

/* One step of so many seconds that ends at this gap. */
void anhyst_plant_coil_step(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            const anhyst_plant_source *source, double gap, double seconds);

/* Moves to a current at a gap in one step of 1/per_second, whatever voltage that takes; 0: so
   slowly that nothing is induced. */
void anhyst_plant_coil_lead(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            double current, double gap, double per_second);

/* Moves straight to a current in so many seconds, in a few such steps. */
void anhyst_plant_coil_follow(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                              double current, double gap, double seconds);

#ifdef __cplusplus
}
#endif
#endif
