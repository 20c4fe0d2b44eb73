/* SPDX-License-Identifier: Apache-2.0 */
/* An electromagnet with a gap: winding, iron, and force. There are two kinds.

   circuit: iron in series with two gaps with fringing, a leakage path parallel to the gaps, and the
   joints of the core. Part of the path may be solid (solid.h); then H is the mean along the path, B
   the mean over the cross-section. Flux linkage and force belong to one circuit, so that energy is
   conserved:

     turns*current = length*H + eddy*length*dB/dt + outer(gap)*area*B,   psi = turns*area*B
     pull = (gap flux)^2/2 * d(gap reluctance)/d(gap)

   A circuit with a bias, such as a voice coil in an iron core, has no gap whose reluctance changes.
   A magnet's own flux produces a force in proportion to the coil flux, in both directions, and
   drives the circuit when the body moves by x in the direction of the force. Energy is conserved:

     turns*current + bias*x = length*H + eddy*length*dB/dt + joints*area*B
     force = bias*area*B - spring*x,   x = middle - gap

   A circuit with a cone (cone.c) has the cone instead of the gaps. The sliding clearance of a
   solenoid's plunger is part of its joints.

   law: an identified model. The force comes from the law, c_H*(I - I_0) through rho(gap) to B and
   c_out*B^2 + F_0; the flux linkage comes from a table psi(I, gap), odd in I.

   The flux linkage is integrated by the trapezoidal rule, dpsi/dt = u - resistance*current. It is
   of second order and stable for any step. If a voltage jumps between two steps, the iron reverses
   exactly there. Both kinds solve one equation with a rising left side. */
#ifndef ANHYST_PLANT_MAGNET_H
#define ANHYST_PLANT_MAGNET_H

#include "anhyst/law/circuit.h"
#include "anhyst_plant/iron.h"
#include "anhyst_plant/solid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The working gap of a solenoid: a plunger in front of a stop with a control cone. Three flux paths
   are parallel: the flat face, the wall of the cone, and leakage without a force. The plunger dips
   into the wall, whose thin end saturates. At ampere-turns u

        flux(u) = (face + leakage)*u + cone*u/sqrt(1 + (cone*u/limit)^2)

   and the force is the decrease of the coenergy (integral of the flux over u) per metre. */
typedef struct {
  double leakage;    /* permeance parallel to the working gap, H */
  double side;       /* side of a square with the area of the flat face, m */
  double fringe;     /* widening of this square on each side by fringing, relative to the gap */
  double around;     /* circumference of the wall, m */
  double clearance;  /* radial clearance between plunger and wall, m */
  double depth;      /* gap at which the plunger starts to dip into the wall, m */
  double onset;      /* length over which the start of the overlap is smoothed, m */
  double thickness;  /* thickness of the wall at its end, m */
  double taper;      /* increase of the wall thickness per metre of depth */
  double saturation; /* flux density at which the wall saturates, T */
} anhyst_plant_cone;

/* Permeances at one gap, H, and their derivatives per metre. */
typedef struct {
  double gap;      /* m */
  double straight; /* permeance of face and leakage together, H */
  double d_face;
  double cone;
  double d_cone;
  double limit; /* saturation flux of the wall, Wb */
  double d_limit;
} anhyst_plant_cone_gap;

void anhyst_plant_evaluate_cone(const anhyst_plant_cone *cone, double gap,
                                anhyst_plant_cone_gap *at);

/* Returns the ampere-turns for a flux, A. The search starts at `near`. *slope: in A per Wb, 1/H. */
double anhyst_plant_cone_mmf(const anhyst_plant_cone_gap *at, double flux, double near,
                             double *slope);

/* Returns the force that closes the gap, N. */
double anhyst_plant_cone_force(const anhyst_plant_cone_gap *at, double mmf);

typedef struct {
  anhyst_plant_iron iron;
  double iron_length; /* m */
  double iron_area;   /* m^2 */
  double pole_width;  /* m */
  double pole_depth;  /* m */
  double leakage;     /* permeance parallel to the gaps, H */
  double joints;      /* reluctance of air in the core, in series with the whole circuit, 1/H */
  double eddy;        /* field that opposes a change of flux density, A s/(m T) */
  double bias;        /* magnetomotive force per m of motion, A/m; 0: the gaps produce the force */
  double middle;      /* gap at which the magnetomotive force of the bias is zero, m */
  double spring;      /* spring constant that acts independently of the flux, N/m */
  const anhyst_plant_solid *solid; /* null: the whole core is laminated, as always with a cone */
  const anhyst_plant_cone *cone;   /* cone of a solenoid; null: two gaps */
} anhyst_plant_circuit;

/* Coefficients of the drive and the output of an identified model at one gap. */
typedef struct {
  double drive;     /* c_H, 1/m */
  double gap_ratio; /* rho */
  double gain;      /* c_out, N/T^2 */
  double offset;    /* output without flux, N */
  double zero;      /* current at which the drive is zero, A */
  double density;   /* flux density in the gap divided by that of the law (arbitrary scale) */
} anhyst_plant_row;

/* Flux linkage as a function of current (0..current_high, equal steps) and gap (equal steps). It
   rises with the current and is odd in it. Interpolation and extrapolation are linear. */
typedef struct {
  const double *psi; /* one row per gap, one entry per current, Wb */
  int currents;      /* >= 2 */
  int gaps;          /* >= 2 */
  double current_high;
  double gap_low;
  double gap_high;
} anhyst_plant_flux_table;

typedef struct {
  const anhyst_iron_f64 *iron;
  const anhyst_plant_row *rows; /* at equal gap steps of the table, interpolated linearly */
  int row_count;                /* >= 2 */
  double eddy;                  /* eddy-current coefficient gamma, A s/(m T) */
  anhyst_plant_flux_table table;
} anhyst_plant_law;

typedef struct {
  const anhyst_plant_circuit *circuit; /* exactly one of circuit and law is not null */
  const anhyst_plant_law *law;
  double turns;
  double resistance; /* ohm */
} anhyst_plant_magnet;

/* Source of the winding in one step: u = gain*(reference - current) + integral + voltage, limited.
   At a limit the integral does not change. With gain and reset 0, it is a voltage source. */
typedef struct {
  double reference; /* A */
  double gain;      /* V/A, >= 0 */
  double reset;     /* integral gain of reference - current, V/(A s) */
  double voltage;   /* V */
  double limit;     /* voltage limit: largest |u|, V */
} anhyst_plant_source;

/* All zeros: demagnetised, no current. */
typedef struct {
  anhyst_plant_memory iron;    /* circuit only: state of the laminated iron */
  anhyst_plant_memory *volume; /* state of the solid iron, the surface first; array of the caller */
  anhyst_memory_f64 law;
  double over;     /* with a cone: ampere-turns across the gap, A */
  double stride;   /* law only: last change of the flux density, T */
  double psi;      /* flux linkage, Wb */
  double current;  /* A */
  double steady;   /* current without that of the eddy currents in the iron, A */
  double voltage;  /* V */
  double integral; /* state of the source's integral term, V */
  double force;    /* N */
  double density;  /* flux density in the gap, T */
  double heat;     /* total heat in the winding's resistance since the start, J */
  double energy;   /* total energy from the amplifier since the start, J */
} anhyst_plant_coil;

/* Executes one step of `seconds` that ends at this gap. */
void anhyst_plant_coil_step(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            const anhyst_plant_source *source, double gap, double seconds);

/* Moves to a current at a gap in one step of 1/per_second, with the necessary voltage. If
   per_second is 0, the step is so slow that nothing is induced. */
void anhyst_plant_coil_lead(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            double current, double gap, double per_second);

/* Moves linearly to a current in `seconds`, divided into eight equal steps. */
void anhyst_plant_coil_follow(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                              double current, double gap, double seconds);

#ifdef __cplusplus
}
#endif
#endif
