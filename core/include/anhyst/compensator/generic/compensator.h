/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator of a controller in floating point: wanted output (force) in, current out,
   in the units of the model.

   At every tick: solve once or more, limit and apply the current, then commit what was really
   applied. solve does not touch the memory of the iron; commit advances it.

     flux    = gain(gap)*root(demand - offset(gap))
     field   = law(memory, flux)
     current = bias(gap) + flux_arm(gap)*flux + field_arm(gap)*field

   The laws, their tables and the number of evaluations are those of the fixed-point compensator:
   what differs between the two is rounding. Nothing here allocates, waits, or loops a number of
   times that depends on data.

   Made of + - * / and comparisons, without a library: the same bits on every target that rounds to
   nearest as IEEE 754 says and does not fuse products into sums (-ffp-contract=off); neither
   -ffast-math nor flushing to zero. A signal that is not a number counts as its lowest value; an
   applied current that is not finite leaves the memory alone. */

/* How flux and current are made up at one gap. Flux is in units of that of saturated iron without
   the air around it; field in a (the law's own scale); output and current in the model's units. */
typedef struct {
  ANHYST_REAL gain;      /* flux for the root of a full-scale output (power 2) or for it (1), > 0 */
  ANHYST_REAL offset;    /* output at zero flux, taken off the demand */
  ANHYST_REAL bias;      /* current at zero flux and field */
  ANHYST_REAL flux_arm;  /* current for a unit of flux; below 0 in the full law alone */
  ANHYST_REAL field_arm; /* current for a unit of field (full) or of u (simplified), > 0 */
} anhyst_at_gap_x;

/* Full: the exact step. Its tables have equal segments, one entry more than segments, and never
   fall. */
typedef struct {
  ANHYST_REAL air;            /* h: flux of the air for a unit of field, > 0 */
  ANHYST_REAL reversible;     /* c, 0..1 */
  ANHYST_REAL play;           /* half-width of the play, field, >= 0 */
  ANHYST_REAL octaves;        /* 1/(kappa*ln 2): halvings of the memory in a unit of field */
  ANHYST_REAL reach;          /* largest field of the tables */
  uint16_t iterations;        /* evaluations of a solve, 2..16 */
  uint16_t curve_segments;    /* 8..4096; the branch has twice as many */
  uint16_t inverse_segments;  /* 8..4096 */
  const ANHYST_REAL *curve;   /* anhysteretic curve over a field of 0..reach, 0..1 */
  const ANHYST_REAL *branch;  /* ascending branch over -reach..reach, -1..1 */
  const ANHYST_REAL *inverse; /* field over the anhysteretic, 0..1 */
} anhyst_full_law_x;

/* Simplified: the closed form. */
typedef struct {
  ANHYST_REAL rate;         /* distance z of a unit of flux, > 0 */
  ANHYST_REAL hold;         /* change of u of a unit of flux while held, rate/(1-nu) */
  ANHYST_REAL nu;           /* 0 <= .. < 1 */
  ANHYST_REAL first;        /* z at the end of the first octave */
  uint16_t iterations;      /* evaluations of a commit, 2..16 */
  uint16_t octaves;         /* 4..15: the table ends at first*2^octaves */
  uint16_t segments;        /* 4, 8 .. 64 up to first, and as many in each octave */
  const ANHYST_REAL *curve; /* p over z, 0..1: (octaves + 1)*segments + 1 entries, rising */
} anhyst_simplified_law_x;

/* Cells: plays in the effective field, which is in A/m here. The rows reach over fields of
   -reach..reach, have one entry more than segments, and never fall. */
typedef struct {
  ANHYST_REAL air;               /* h: flux of the air for a unit of field, > 0 */
  ANHYST_REAL reach;             /* largest field of the rows */
  ANHYST_REAL inner;             /* field up to which segments are narrow; reach if wide is 0 */
  uint16_t cells;                /* plays with a width, 1..12 */
  uint16_t narrow;               /* equal segments on each side of zero up to inner, 4..1024 */
  uint16_t wide;                 /* and from there to reach, 0..1024 */
  const ANHYST_REAL *thresholds; /* half-widths of the plays, rising from above 0 to reach */
  const ANHYST_REAL *rows;       /* magnetisation of the first 1, 2, .. cells + 1 plays, -1..1 */
} anhyst_cells_law_x;

typedef struct anhyst_kernel_x anhyst_kernel_x;
#if ANHYST_MEMORIES > 1
typedef struct anhyst_solid_x anhyst_solid_x;
#endif

/* What a compensator knows of its actuator; constant. */
typedef struct {
  const anhyst_kernel_x *kernel; /* anhyst_kernel_full_.., .._simplified_.., .._cells_.. */
  const anhyst_full_law_x *full; /* of the kernel full, otherwise 0 */
  const anhyst_simplified_law_x *simplified; /* of the kernel simplified */
  const anhyst_cells_law_x *cells;           /* of the kernel cells */
  ANHYST_REAL demand_low;                    /* limits of the demand */
  ANHYST_REAL demand_high;
  ANHYST_REAL current_low; /* limits of the current */
  ANHYST_REAL current_high;
  ANHYST_REAL full_scale;      /* output that counts as 1 under the root, > 0 */
  ANHYST_REAL knee;            /* root below which it is a straight line, 2^-8..1/4 */
  ANHYST_REAL flux_limit;      /* largest |flux| solved for */
  ANHYST_REAL gap_low;         /* gap of the first row */
  ANHYST_REAL gap_rows;        /* rows for a unit of the gap; 0: nothing runs over it */
  const anhyst_at_gap_x *gaps; /* gap_segments + 1 rows, interpolated */
  uint16_t gap_segments;       /* 1..64 */
  uint16_t power;              /* 2: output is a force, flux its root; 1: linear */
  uint16_t condition_cycles;   /* ramps up and down that make the state known, 0..64 */
  uint16_t condition_ticks;    /* ticks of one ramp, 2..32767 */
#if ANHYST_MEMORIES > 1
  const anhyst_solid_x *solid; /* 0: thin iron */
#endif
} anhyst_parameters_x;

/* Of the full law. */
typedef struct {
  ANHYST_REAL x;     /* field */
  ANHYST_REAL y;     /* irreversible magnetisation */
  ANHYST_REAL p;     /* play */
  ANHYST_REAL turn;  /* play where it last turned */
  ANHYST_REAL level; /* y there */
} anhyst_full_memory_x;

/* Of the closed form. */
typedef struct {
  ANHYST_REAL flux;
  ANHYST_REAL u;     /* bounded state */
  ANHYST_REAL z;     /* distance where the path turned */
  ANHYST_REAL turn;  /* flux there; where it is now: not known, it turns now */
  ANHYST_REAL level; /* u there */
} anhyst_simplified_memory_x;

/* Of the law of cells. */
typedef struct {
  ANHYST_REAL x;      /* field */
  ANHYST_REAL rest;   /* magnetisation of the plays that rest */
  ANHYST_REAL active; /* how many of the plays move, below 0 where the field falls; 0: rest is not
                         known */
  uint32_t risen;     /* bit i: play i came to rest while the field rose */
} anhyst_cells_memory_x;

/* What the iron remembers. All zero is the demagnetised state. Beside where it is, it keeps where
   the path now followed turned, and a step is computed from there: ticks of any number and size add
   no rounding. */
typedef union {
  ANHYST_REAL number[5]; /* of the laws full and simplified; the first three of any */
  anhyst_full_memory_x full;
  anhyst_simplified_memory_x simplified;
  anhyst_cells_memory_x cells;
} anhyst_memory_x;

/* A law. The first two functions leave *from and the plays alone and fill *to, which may not be
 *from. plays: where the plays of the law of cells rest; nothing to the other laws. */
struct anhyst_kernel_x {
  /* The field that belongs to a flux. */
  ANHYST_REAL (*field)(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
                       const ANHYST_REAL *plays, ANHYST_REAL flux, anhyst_memory_x *to);
  /* The flux to which a current leads: bias + flux_arm*flux + field_arm*field = current. */
  ANHYST_REAL (*flux)(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
                      const ANHYST_REAL *plays, const anhyst_at_gap_x *arms, ANHYST_REAL current,
                      anhyst_memory_x *to);
  /* Whether the law's own parameters are valid. */
  int (*valid)(const anhyst_parameters_x *parameters);
  /* Brings a memory from these to other parameters of the same law: it turns where it is. */
  void (*carry)(const anhyst_parameters_x *before, anhyst_memory_x *memory, ANHYST_REAL *plays);
  /* Takes over into the plays what a step between two memories leaves in them; 0: nothing. */
  void (*keep)(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
               const anhyst_memory_x *to, ANHYST_REAL *plays);
};

extern const anhyst_kernel_x anhyst_kernel_full_x;
extern const anhyst_kernel_x anhyst_kernel_simplified_x;
extern const anhyst_kernel_x anhyst_kernel_cells_x;

#if ANHYST_MEMORIES > 1
/* Solid iron: layers of the law, the first at the surface; N of them, with a tick of T. */
struct anhyst_solid_x {
  /* The flux under which a memory stands, and how the field rises with it, the way it came:
     anhyst_cells_stand_... */
  ANHYST_REAL (*stand)(const anhyst_parameters_x *parameters, const anhyst_memory_x *memory,
                       const ANHYST_REAL *plays, ANHYST_REAL *slope);
  ANHYST_REAL hold;      /* field from layer to layer where a flux of 1 is more than a tick before,
                            gamma/((N - 1)*T) in units of field over flux, >= 0 */
  ANHYST_REAL own;       /* field for a unit of flux in a layer, beside that of the law, <= 0 */
  ANHYST_REAL surface;   /* share of the first layer in the section, 0..1 */
  ANHYST_REAL laminated; /* share of the path in which the field is the same throughout, 0..1 */
  uint16_t layers;       /* N, 2 to ANHYST_MEMORIES; one less if there is something laminated */
};

/* Of the law of cells. */
ANHYST_REAL anhyst_cells_stand_x(const anhyst_parameters_x *parameters,
                                 const anhyst_memory_x *memory, const ANHYST_REAL *plays,
                                 ANHYST_REAL *slope);

/* A layer below the surface, or what is laminated. */
typedef struct {
  anhyst_memory_x memory;
  ANHYST_REAL plays[ANHYST_CELLS];
  anhyst_memory_x next;
} anhyst_deeper_x;
#endif

/* One compensator: 112 bytes in single precision on targets with 32-bit pointers. */
typedef struct {
  const anhyst_parameters_x *parameters;
  anhyst_memory_x memory;          /* of what was applied */
  ANHYST_REAL plays[ANHYST_CELLS]; /* law of cells: where they rest */
  anhyst_memory_x next;            /* where the solved current would lead */
  ANHYST_REAL current;             /* solved */
  ANHYST_REAL flux;                /* solved */
  ANHYST_REAL flux_applied;        /* after the last commit */
  ANHYST_REAL gap;                 /* for which was solved */
  uint16_t flags;                  /* of the last solve, see flags.h */
  uint16_t solved;                 /* whether next belongs to memory */
#if ANHYST_MEMORIES > 1
  anhyst_deeper_x deeper[ANHYST_MEMORIES - 1];
#endif
} anhyst_compensator_x;

/* Whether parameters are valid: ANHYST_OK or ANHYST_BAD_PARAMETER. Reads every entry of the
   tables; not for an interrupt. */
anhyst_status anhyst_parameters_check_x(const anhyst_parameters_x *parameters);

/* Starts with the demagnetised state. ANHYST_OK, or ANHYST_BAD_PARAMETER where the parameters are
   not valid; nothing is changed then. */
anhyst_status anhyst_compensator_init_x(anhyst_compensator_x *c,
                                        const anhyst_parameters_x *parameters);

/* Goes on with other parameters of the same kernel, which must have passed the check. The memory is
   kept: it means the same under both. Between two ticks. */
void anhyst_compensator_swap_x(anhyst_compensator_x *c, const anhyst_parameters_x *parameters);

/* The current that gives the demanded output now. */
ANHYST_REAL anhyst_compensator_solve_x(anhyst_compensator_x *c, ANHYST_REAL demand,
                                       ANHYST_REAL gap);

/* Advances the memory with the current that was applied, at the gap there was. If both are what
   was solved for, this costs a copy; otherwise as much as a solve. */
void anhyst_compensator_commit_x(anhyst_compensator_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

/* The output that the model expects after the last commit. */
ANHYST_REAL
anhyst_compensator_output_x(const anhyst_compensator_x *c);

/* Number of ticks of the sequence that makes an unknown state known. */
int32_t anhyst_conditioning_length_x(const anhyst_compensator_x *c);

/* The current of its tick 0, 1, ...: triangles between the limits of the current; 0 after the
   end. Apply it and commit it as any other. */
ANHYST_REAL anhyst_conditioning_x(const anhyst_compensator_x *c, int32_t tick);
