/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in floating point: from the demanded output (force) and the gap to the coil
   current, in the units of the model.

   In each tick (control period), call solve, limit and apply the current, then commit the current
   that was really applied. solve does not change the hysteresis state; commit advances it.

     flux    = gain(gap)*root(demand - offset(gap))
     field   = law(state, flux)
     current = bias(gap) + flux_arm(gap)*flux + field_arm(gap)*field

   Laws, parameter block and algorithm are those of the fixed-point compensator (compensator.h): one
   source text serves every format. A word of a block contains the value of the corresponding
   fixed-point word without its rounding: 0.5 for a q15 of 16384, 0.25 for a weight of 16384. The
   exponent of a weight is 0. A number of the format "single" is in the first of its two words.
   Internally, field, flux, demand and current are fractions of full scale.

   The code uses only + - * / and comparisons, and no library. Results have the same bits on every
   target that rounds to nearest as IEEE 754 defines and does not fuse products into sums
   (-ffp-contract=off). The compiler option -ffast-math causes an error. A demand or a gap that is
   NaN counts as the lowest value of its range. An applied current that is not finite leaves the
   hysteresis state unchanged. */

/* State of the Jiles-Atherton law, fractions of full scale. */
typedef struct {
  ANHYST_REAL x;             /* effective field */
  ANHYST_REAL y;             /* irreversible magnetisation */
  ANHYST_REAL p;             /* position of the play: field that drives the irreversible part */
  ANHYST_REAL reversal_play; /* position of the play at the last reversal */
  ANHYST_REAL reversal_y;    /* y at the last reversal */
} anhyst_full_memory_x;

/* State of the simplified law. The law follows a path from the flux `start_flux` to the flux
   `peak_flux`. If these two are equal, no path is stored. The bounded state u is the hysteresis
   field relative to its maximum. */
typedef struct {
  ANHYST_REAL flux;
  ANHYST_REAL u;           /* bounded state u at the peak */
  ANHYST_REAL start_flux;  /* flux at the start of the path */
  ANHYST_REAL peak_flux;   /* farthest flux of the path */
  ANHYST_REAL start_state; /* in the direction of the path: u at its start if below 0; otherwise the
                              distance z (closed_form.h) at its start */
} anhyst_simplified_memory_x;

/* State of the play-cell law. Mirrored means: multiplied by -1 if the field falls. */
typedef struct {
  ANHYST_REAL x;         /* effective field */
  ANHYST_REAL resting_m; /* sum of the magnetisations of the cells at rest */
  int32_t active; /* number of moving cells, < 0 if the field falls; 0: `resting_m` is unknown */
  int32_t stopped_on_rise;     /* bit i: cell i came to rest while the field rose */
  ANHYST_REAL last_activation; /* field where the last cell started to move, mirrored */
} anhyst_cells_memory_x;

/* Hysteresis state of the iron. If all members are 0, the iron is demagnetised. */
typedef union {
  anhyst_full_memory_x full;
  anhyst_simplified_memory_x simplified;
  anhyst_cells_memory_x cells;
} anhyst_memory_x;

/* Magnetisation and slopes at the end of a trial step, from which the next search starts. */
typedef struct {
  ANHYST_REAL m;       /* magnetisation */
  ANHYST_REAL y_slope; /* d(irreversible part)/d(field) */
  ANHYST_REAL m_slope; /* d(magnetisation)/d(field) */
  int16_t direction;   /* direction of the field. 1: it rises; -1: it falls; 0: it is constant */
} anhyst_full_candidate_x;

typedef struct {
  ANHYST_REAL next_activation; /* field where the next cell starts to move, mirrored */
  ANHYST_REAL flux;            /* flux at the lower end of the table segment, divided by 4 */
  ANHYST_REAL row_rise;        /* rise of the table row within the segment */
  ANHYST_REAL begin_field;     /* field at the lower end of the segment, mirrored */
  ANHYST_REAL width;           /* width of the segment */
  int32_t segment;             /* index in the block of the entry at the lower end; 0: unknown */
} anhyst_cells_candidate_x;

typedef union {
  anhyst_full_candidate_x full;
  anhyst_cells_candidate_x cells;
} anhyst_candidate_of_x;

/* A trial step: the state at its end, and data for a quick search near this state. */
typedef struct {
  anhyst_memory_x memory;
  anhyst_candidate_of_x of;
} anhyst_candidate_x;

/* Coefficients of the current at the gap of this tick. */
typedef struct {
  ANHYST_REAL bias;
  ANHYST_REAL flux_arm;  /* current for a flux of 1.0; < 0 only with kinds full and cells */
  ANHYST_REAL field_arm; /* current for a field of 1.0, > 0 */
} anhyst_arms_x;

struct anhyst_compensator_x;

/* A hysteresis law, as a table of functions; see anhyst_kernel of compensator.h. */
typedef struct anhyst_kernel_x {
  uint16_t kind;
  ANHYST_REAL (*field)(struct anhyst_compensator_x *c);
  ANHYST_REAL (*flux)(struct anhyst_compensator_x *c, ANHYST_REAL current);
  int (*valid)(const ANHYST_REAL *words);
  void (*carry)(struct anhyst_compensator_x *c, const ANHYST_REAL *words, ANHYST_REAL flux);
  void (*keep)(struct anhyst_compensator_x *c);
  void (*start)(struct anhyst_compensator_x *c);
  const struct anhyst_kernel_x *(*for_block)(const ANHYST_REAL *words);
} anhyst_kernel_x;

extern const anhyst_kernel_x anhyst_kernel_full_x;
extern const anhyst_kernel_x anhyst_kernel_simplified_x;
extern const anhyst_kernel_x anhyst_kernel_cells_x;

#if ANHYST_MEMORIES > 1
/* A layer of solid iron below the surface layer, or the laminated part; see compensator.h. */
typedef struct {
  anhyst_memory_x memory;
  ANHYST_REAL plays[ANHYST_CELLS];
  anhyst_candidate_x next;
  ANHYST_REAL flux_deficit;
  ANHYST_REAL next_flux_deficit;
  ANHYST_REAL start_flux;
  ANHYST_REAL stiffness;
} anhyst_deeper_x;
#endif

/* A compensator. For laminated iron, at most 176 bytes in single precision with 32-bit pointers. */
typedef struct anhyst_compensator_x {
  const anhyst_kernel_x *kernel;
  const ANHYST_REAL *words;        /* active parameter block; never written */
  anhyst_memory_x memory;          /* hysteresis state after the last commit */
  ANHYST_REAL plays[ANHYST_CELLS]; /* positions of the plays of the cells at rest */
  anhyst_candidate_x next;         /* trial step; `stage` states its meaning */
  anhyst_arms_x arms;              /* coefficients at the gap of the last solve or commit */
  ANHYST_REAL per_demand;          /* 1/full scale of the demand */
  ANHYST_REAL per_current;         /* 1/full scale of the current */
  ANHYST_REAL per_gap;             /* 1/range of the gap; 0: no parameter depends on the gap */
  ANHYST_REAL current;             /* result of the last solve, fraction of full scale */
  ANHYST_REAL flux;                /* flux of the last solve */
  ANHYST_REAL flux_applied;        /* flux after the last commit */
  ANHYST_REAL ring_lead;           /* flux inside a leaky ring minus flux_applied */
  ANHYST_REAL applied;             /* current of the last commit, fraction of full scale */
  int32_t conditioned;             /* number of completed ticks of the conditioning sequence */
  ANHYST_REAL gap;                 /* gap of the last solve or commit, in the unit of the model */
  uint16_t flags;                  /* flags of the last solve and its commit, see flags.h */
  uint16_t stage;                  /* meaning of `next`, see stage.h; if known, `arms` fits `gap` */
#if ANHYST_MEMORIES > 1
  anhyst_deeper_x deeper[ANHYST_MEMORIES - 1];
#endif
} anhyst_compensator_x;

/* Work as anhyst_compensator_init_sized and anhyst_compensator_init of compensator.h. */
anhyst_status anhyst_compensator_init_sized_x(anhyst_compensator_x *c, size_t size,
                                              const anhyst_kernel_x *kernel,
                                              const ANHYST_REAL *words, uint32_t capacity);

static inline anhyst_status anhyst_compensator_init_x(anhyst_compensator_x *c,
                                                      const anhyst_kernel_x *kernel,
                                                      const ANHYST_REAL *words, uint32_t capacity)
{
  return anhyst_compensator_init_sized_x(c, sizeof *c, kernel, words, capacity);
}

/* Sets the state to that of demagnetised iron. */
void anhyst_compensator_demagnetise_x(anhyst_compensator_x *c);

/* Returns ANHYST_OK if a block is valid and has the kind of the kernel, otherwise
   ANHYST_BAD_PARAMETER. Reads at most `capacity` words. Must not be called from an ISR. */
anhyst_status anhyst_block_check_x(const anhyst_kernel_x *kernel, const ANHYST_REAL *words,
                                   uint32_t capacity);

/* Works as anhyst_block_misfit of compensator.h. */
uint16_t anhyst_block_misfit_x(const ANHYST_REAL *words, const ANHYST_REAL *scales);

/* Works as anhyst_compensator_swap of compensator.h. */
void anhyst_compensator_swap_x(anhyst_compensator_x *c, const ANHYST_REAL *words);

/* Returns the current for the demanded output, starting from the present hysteresis state. Flags
   and run time are those of anhyst_compensator_solve_q31, with two additions. A gap that is NaN or
   out of the range of the block by more than 2^-15 of the range sets ANHYST_GAP_LIMITED. A demand
   that is NaN sets ANHYST_DEMAND_LIMITED. */
ANHYST_REAL anhyst_compensator_solve_x(anhyst_compensator_x *c, ANHYST_REAL demand,
                                       ANHYST_REAL gap);

/* Advances the hysteresis state with the applied current at the actual gap. Flags and run time are
   those of anhyst_compensator_commit_q31. A current above twice full scale counts as twice full
   scale. A current that is not finite sets ANHYST_CURRENT_LIMITED and keeps the state. */
void anhyst_compensator_commit_x(anhyst_compensator_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

/* Returns the output that the model predicts after the last commit. */
ANHYST_REAL
anhyst_compensator_output_x(const anhyst_compensator_x *c);

/* Returns the length of the conditioning sequence, ticks. The sequence brings the iron from an
   unknown hysteresis state to a known one. */
int32_t anhyst_conditioning_length_x(const anhyst_compensator_x *c);

/* Returns the current of the conditioning sequence for tick 0, 1, ...: triangles between the limits
   of the current; 0 after the end. WARNING: the actuator produces its largest force and may move;
   secure the load first. Apply and commit the current like any other current. */
ANHYST_REAL anhyst_conditioning_x(const anhyst_compensator_x *c, int32_t tick);

/* Works as anhyst_conditioning_step of compensator.h. */
ANHYST_REAL anhyst_conditioning_step_x(anhyst_compensator_x *c);

/* Works as anhyst_compensator_follows of compensator.h. Returns 0 for a measured current of NaN. */
int anhyst_compensator_follows_x(const anhyst_compensator_x *c, ANHYST_REAL measured,
                                 ANHYST_REAL tolerance);

/* Works as anhyst_compensator_commit_after of compensator.h. */
void anhyst_compensator_commit_after_x(anhyst_compensator_x *c, ANHYST_REAL applied,
                                       ANHYST_REAL gap, uint16_t ticks);

/* The stored hysteresis state, as anhyst_saved_memory of compensator.h. */
typedef struct {
  anhyst_memory_x memory;
  ANHYST_REAL plays[ANHYST_CELLS];
  ANHYST_REAL flux_deficit;
} anhyst_saved_layer_x;

typedef struct {
  uint32_t checksum;
  uint32_t block;
  uint16_t version;
  uint16_t kind;
  uint32_t size;
  ANHYST_REAL flux_applied;
  ANHYST_REAL ring_lead;
  ANHYST_REAL applied;
  ANHYST_REAL gap;
  anhyst_saved_layer_x layer[ANHYST_MEMORIES];
} anhyst_saved_content_x;

typedef union {
  anhyst_saved_content_x content;
  uint16_t word[ANHYST_WORDS_OF(anhyst_saved_content_x)];
} anhyst_saved_memory_x;

/* Works as anhyst_compensator_save of compensator.h. */
void anhyst_compensator_save_x(const anhyst_compensator_x *c, anhyst_saved_memory_x *to);

/* Works as anhyst_compensator_restore of compensator.h. */
anhyst_status anhyst_compensator_restore_x(anhyst_compensator_x *c,
                                           const anhyst_saved_memory_x *from);
