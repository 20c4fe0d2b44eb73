/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in floating point: demanded output (force) in, current out, in the units of the
   model.

   In each tick, solve once or more, limit and apply the current, then commit the current that was
   really applied. solve does not change the hysteresis state; commit advances it.

     flux    = gain(gap)*root(demand - offset(gap))
     field   = law(state, flux)
     current = bias(gap) + flux_arm(gap)*flux + field_arm(gap)*field

   Laws, parameter block and algorithm are those of the fixed-point compensator (compensator.h): one
   source text serves every format. A word of a block contains the value of the corresponding
   fixed-point word without its rounding: a q15 of 16384 is 0.5, a weight of 16384 is 0.25, the
   exponent of a weight is 0, a "single" is in the first of its two words. Internally, field, flux,
   demand and current are fractions of full scale.

   The code uses only + - * / and comparisons, and no library. Results have the same bits on every
   target that rounds to nearest as IEEE 754 defines and does not fuse products into sums
   (-ffp-contract=off). -ffast-math is rejected. A signal that is NaN counts as its lowest value. An
   applied current that is not finite leaves the state unchanged. */

/* State of the Jiles-Atherton law, fractions of full scale. */
typedef struct {
  ANHYST_REAL x;     /* field */
  ANHYST_REAL y;     /* irreversible magnetisation */
  ANHYST_REAL p;     /* play: field that drives the irreversible part */
  ANHYST_REAL turn;  /* play at the last reversal */
  ANHYST_REAL level; /* y at the last reversal */
} anhyst_full_memory_x;

/* State of the closed form. The remembered path starts at `turn` and extends to `peak`; no path is
   known if both are equal. */
typedef struct {
  ANHYST_REAL flux;
  ANHYST_REAL u;     /* bounded state at the peak */
  ANHYST_REAL turn;  /* flux at the start of the path */
  ANHYST_REAL peak;  /* farthest flux of the path */
  ANHYST_REAL start; /* at the start of the path and in its direction: the bounded state if it is
                        below 0, otherwise the distance */
} anhyst_simplified_memory_x;

/* State of the play-cell law. */
typedef struct {
  ANHYST_REAL x;      /* field */
  ANHYST_REAL rest;   /* magnetisation of the cells at rest */
  int32_t active;     /* number of moving cells, negative if the field falls; 0: rest is unknown */
  int32_t risen;      /* bit i: play i came to rest while the field rose */
  ANHYST_REAL joined; /* field where the last cell started to move, mirrored if the field falls */
} anhyst_cells_memory_x;

/* Hysteresis state of the iron. All zeros is the demagnetised state. */
typedef union {
  anhyst_full_memory_x full;
  anhyst_simplified_memory_x simplified;
  anhyst_cells_memory_x cells;
} anhyst_memory_x;

/* What a law knows about a position in addition to the state there. */
typedef struct {
  ANHYST_REAL m;       /* magnetisation */
  ANHYST_REAL y_slope; /* slope of the irreversible part over the field */
  ANHYST_REAL m_slope; /* slope of the magnetisation over the field */
  int16_t direction;   /* 1: the field rises; -1: it falls; 0: it is constant */
} anhyst_full_candidate_x;

typedef struct {
  ANHYST_REAL joins; /* field where the next cell joins, mirrored if the field falls */
  ANHYST_REAL flux;  /* air*x + m at the lower end of the segment, divided by 4 */
  ANHYST_REAL rise;  /* rise of the row over the segment */
  ANHYST_REAL begin; /* field at the lower end of the segment, mirrored if the field falls */
  ANHYST_REAL width; /* width of the segment */
  int32_t segment;   /* index of the block word where the segment starts; 0: no segment is known */
} anhyst_cells_candidate_x;

typedef union {
  anhyst_full_candidate_x full;
  anhyst_cells_candidate_x cells;
} anhyst_candidate_of_x;

/* A trial step: the state after the step, and data for a quick search near it. */
typedef struct {
  anhyst_memory_x memory;
  anhyst_candidate_of_x of;
} anhyst_candidate_x;

/* Coefficients of the current at the gap of this tick. */
typedef struct {
  ANHYST_REAL bias;
  ANHYST_REAL flux_arm;  /* negative in the full and play-cell laws only */
  ANHYST_REAL field_arm; /* > 0 */
} anhyst_arms_x;

struct anhyst_compensator_x;

/* Interface between the compensator and a hysteresis law; see anhyst_kernel of compensator.h. */
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
  ANHYST_REAL owed;
  ANHYST_REAL next_owed;
  ANHYST_REAL before;
  ANHYST_REAL stiffness;
} anhyst_deeper_x;
#endif

/* A compensator. For laminated iron: at most 172 bytes in single precision with 32-bit pointers. */
typedef struct anhyst_compensator_x {
  const anhyst_kernel_x *kernel;
  const ANHYST_REAL *words;        /* parameter block in use; never written */
  anhyst_memory_x memory;          /* state after the last commit */
  ANHYST_REAL plays[ANHYST_CELLS]; /* play-cell law: plays of the cells at rest */
  anhyst_candidate_x next;         /* trial step; stage states its meaning */
  anhyst_arms_x arms;              /* at the gap of the last solve or commit */
  ANHYST_REAL per_demand;          /* 1/full scale of the demand */
  ANHYST_REAL per_current;         /* 1/full scale of the current */
  ANHYST_REAL per_gap;             /* 1/range of the gap; 0: nothing depends on the gap */
  ANHYST_REAL current;             /* result of the last solve, a fraction */
  ANHYST_REAL flux;                /* of the last solve */
  ANHYST_REAL flux_applied;        /* after the last commit */
  ANHYST_REAL applied;             /* current of the last commit, a fraction */
  int32_t conditioned;             /* ticks of the start-up sequence that are done */
  ANHYST_REAL gap;                 /* of the last solve or commit, as given */
  uint16_t flags;                  /* of the last solve and its commit; see flags.h */
  uint16_t stage;                  /* of next, see stage.h; unless UNKNOWN, arms match the gap */
#if ANHYST_MEMORIES > 1
  anhyst_deeper_x deeper[ANHYST_MEMORIES - 1];
#endif
} anhyst_compensator_x;

/* As anhyst_compensator_init_sized and anhyst_compensator_init of compensator.h. */
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

/* Returns ANHYST_OK if a block is valid and of the kernel's kind, otherwise ANHYST_BAD_PARAMETER.
   Reads at most capacity words. Must not be called from an ISR. */
anhyst_status anhyst_block_check_x(const anhyst_kernel_x *kernel, const ANHYST_REAL *words,
                                   uint32_t capacity);

/* As anhyst_block_misfit. */
uint16_t anhyst_block_misfit_x(const ANHYST_REAL *words, const ANHYST_REAL *scales);

/* As anhyst_compensator_swap. */
void anhyst_compensator_swap_x(anhyst_compensator_x *c, const ANHYST_REAL *words);

/* Returns the current for the demanded output, starting from the present state. Flags and cost are
   those of anhyst_compensator_solve_q31. A gap that is NaN or out of the range of the block by more
   than 2^-15 of the range sets ANHYST_GAP_LIMITED. A demand that is NaN sets
   ANHYST_DEMAND_LIMITED. */
ANHYST_REAL anhyst_compensator_solve_x(anhyst_compensator_x *c, ANHYST_REAL demand,
                                       ANHYST_REAL gap);

/* Advances the state with the applied current at the actual gap. Flags and cost are those of
   anhyst_compensator_commit_q31. A current above twice full scale counts as twice full scale. A
   current that is not finite sets ANHYST_CURRENT_LIMITED and leaves the state unchanged. */
void anhyst_compensator_commit_x(anhyst_compensator_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

/* Returns the output that the model predicts after the last commit. */
ANHYST_REAL
anhyst_compensator_output_x(const anhyst_compensator_x *c);

/* Returns the ticks of the conditioning sequence, which brings an unknown state to a known one. */
int32_t anhyst_conditioning_length_x(const anhyst_compensator_x *c);

/* Returns the current of the conditioning sequence for tick 0, 1, ...: triangles between the limits
   of the current; 0 after the end. Apply and commit it like any other current. */
ANHYST_REAL anhyst_conditioning_x(const anhyst_compensator_x *c, int32_t tick);

/* As anhyst_conditioning_step of compensator.h. */
ANHYST_REAL anhyst_conditioning_step_x(anhyst_compensator_x *c);

/* As anhyst_compensator_follows. Returns 0 for a measured current that is NaN. */
int anhyst_compensator_follows_x(const anhyst_compensator_x *c, ANHYST_REAL measured,
                                 ANHYST_REAL tolerance);

/* As anhyst_compensator_commit_after. */
void anhyst_compensator_commit_after_x(anhyst_compensator_x *c, ANHYST_REAL applied,
                                       ANHYST_REAL gap, uint16_t ticks);

/* As anhyst_saved_memory. */
typedef struct {
  anhyst_memory_x memory;
  ANHYST_REAL plays[ANHYST_CELLS];
  ANHYST_REAL owed;
} anhyst_saved_layer_x;

typedef struct {
  uint32_t checksum;
  uint32_t block;
  uint16_t version;
  uint16_t kind;
  uint32_t size;
  ANHYST_REAL flux_applied;
  ANHYST_REAL applied;
  ANHYST_REAL gap;
  anhyst_saved_layer_x layer[ANHYST_MEMORIES];
} anhyst_saved_content_x;

typedef union {
  anhyst_saved_content_x content;
  uint16_t word[ANHYST_WORDS_OF(anhyst_saved_content_x)];
} anhyst_saved_memory_x;

/* As anhyst_compensator_save. */
void anhyst_compensator_save_x(const anhyst_compensator_x *c, anhyst_saved_memory_x *to);

/* As anhyst_compensator_restore. */
anhyst_status anhyst_compensator_restore_x(anhyst_compensator_x *c,
                                           const anhyst_saved_memory_x *from);
