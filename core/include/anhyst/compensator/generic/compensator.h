/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator of a controller in floating point: wanted output (force) in, current out,
   in the units of the model.

   At every tick: solve once or more, limit and apply the current, then commit what was really
   applied. solve does not touch the memory of the iron; commit advances it.

     flux    = gain(gap)*root(demand - offset(gap))
     field   = law(memory, flux)
     current = bias(gap) + flux_arm(gap)*flux + field_arm(gap)*field

   The laws, the parameter block and the algorithm are those of the fixed-point compensator
   (compensator.h): one text serves every format. A word of a block here is the number that the word
   of a fixed-point block stands for, without its rounding: a q15 of 16384 is 0.5, a weight of 16384
   is 0.25, an exponent that goes with a weight is 0, a "single" stands in the first of its two
   words. Inside, field, flux, demand and current are fractions as there.

   Made of + - * / and comparisons, without a library: the same bits on every target that rounds to
   nearest as IEEE 754 says and does not fuse products into sums (-ffp-contract=off). -ffast-math
   is refused. A signal that is not a number counts as its lowest value; an applied current that is
   not finite leaves the memory alone. */

/* Of the law of Jiles and Atherton, fractions. */
typedef struct {
  ANHYST_REAL x;     /* field */
  ANHYST_REAL y;     /* irreversible magnetisation */
  ANHYST_REAL p;     /* play */
  ANHYST_REAL turn;  /* play where it last turned */
  ANHYST_REAL level; /* y there */
} anhyst_full_memory_x;

/* State of the closed form. The path that the iron remembers begins at `turn` and reaches to
   `peak`; no path is known if both are equal. */
typedef struct {
  ANHYST_REAL flux;
  ANHYST_REAL u;     /* bounded state at the peak */
  ANHYST_REAL turn;  /* flux where the path begins */
  ANHYST_REAL peak;  /* farthest flux of the path */
  ANHYST_REAL start; /* where the path begins, in its direction: the bounded state if it is below 0,
                        otherwise the distance */
} anhyst_simplified_memory_x;

/* Of play cells. */
typedef struct {
  ANHYST_REAL x;      /* field */
  ANHYST_REAL rest;   /* magnetisation of the plays that rest */
  int32_t active;     /* how many of the plays move, below 0 where the field falls; 0: rest is not
                         known */
  int32_t risen;      /* bit i: play i came to rest while the field rose */
  ANHYST_REAL joined; /* field, in its direction, where the last one joined */
} anhyst_cells_memory_x;

/* What the iron remembers. All zero is the demagnetised state. */
typedef union {
  anhyst_full_memory_x full;
  anhyst_simplified_memory_x simplified;
  anhyst_cells_memory_x cells;
} anhyst_memory_x;

/* What a law knows of a place beside the memory there. */
typedef struct {
  ANHYST_REAL m;       /* magnetisation */
  ANHYST_REAL y_slope; /* of the irreversible part over the field */
  ANHYST_REAL m_slope; /* of the magnetisation */
  int16_t direction;   /* 1: the field rises, -1: it falls, 0: it stays */
} anhyst_full_candidate_x;

typedef struct {
  ANHYST_REAL joins; /* field where the next play joins, in the direction */
  ANHYST_REAL flux;  /* air*x + m where the segment of the row begins, over 4 */
  ANHYST_REAL rise;  /* rise of the row on the segment */
  ANHYST_REAL begin; /* field where the segment begins, in the direction */
  ANHYST_REAL width; /* width of the segment */
  int32_t segment;   /* word of the block with which the segment begins; 0: nothing is known */
} anhyst_cells_candidate_x;

typedef union {
  anhyst_full_candidate_x full;
  anhyst_cells_candidate_x cells;
} anhyst_candidate_of_x;

/* A place on the path, and what a search near it needs. */
typedef struct {
  anhyst_memory_x memory;
  anhyst_candidate_of_x of;
} anhyst_candidate_x;

/* How the current is made up at the gap of this tick. */
typedef struct {
  ANHYST_REAL bias;
  ANHYST_REAL flux_arm;  /* below 0 in full and cells alone */
  ANHYST_REAL field_arm; /* > 0 */
} anhyst_arms_x;

struct anhyst_compensator_x;

/* A law: all that a compensator asks of one. As anhyst_kernel of compensator.h says. */
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
/* A layer of solid iron below the surface, or what is laminated; as in compensator.h. */
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

/* One compensator: 172 bytes or fewer in single precision on targets with 32-bit pointers, for thin
   iron. */
typedef struct anhyst_compensator_x {
  const anhyst_kernel_x *kernel;
  const ANHYST_REAL *words;        /* the parameter block in use; read only */
  anhyst_memory_x memory;          /* of what was applied */
  ANHYST_REAL plays[ANHYST_CELLS]; /* law of cells: where they rest */
  anhyst_candidate_x next;         /* what it is: see stage */
  anhyst_arms_x arms;              /* at the gap for which was solved */
  ANHYST_REAL per_demand;          /* 1 over full scale of the demand */
  ANHYST_REAL per_current;         /* 1 over full scale of the current */
  ANHYST_REAL per_gap;             /* 1 over the range of the gap; 0: nothing depends on it */
  ANHYST_REAL current;             /* solved, a fraction */
  ANHYST_REAL flux;                /* solved */
  ANHYST_REAL flux_applied;        /* after the last commit */
  ANHYST_REAL applied;             /* current of the last commit, a fraction */
  int32_t conditioned;             /* ticks of the start-up sequence that were given */
  ANHYST_REAL gap;                 /* for which was solved, as it was given */
  uint16_t flags;                  /* of the last solve and its commit, see flags.h */
  uint16_t stage;                  /* of next, see stage.h; arms belong to gap unless UNKNOWN */
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

/* Takes the iron for demagnetised from now on. */
void anhyst_compensator_demagnetise_x(anhyst_compensator_x *c);

/* Whether a block is valid and of this kind: ANHYST_OK or ANHYST_BAD_PARAMETER. Reads at most
   capacity words. Not for an interrupt. */
anhyst_status anhyst_block_check_x(const anhyst_kernel_x *kernel, const ANHYST_REAL *words,
                                   uint32_t capacity);

/* As anhyst_block_misfit. */
uint16_t anhyst_block_misfit_x(const ANHYST_REAL *words, const ANHYST_REAL *scales);

/* As anhyst_compensator_swap. */
void anhyst_compensator_swap_x(anhyst_compensator_x *c, const ANHYST_REAL *words);

/* Returns the current that gives the demanded output now. Flags and cost are those of
   anhyst_compensator_solve_q31. A gap that is not a number or out of the range of the block by more
   than 2^-15 of the range sets ANHYST_GAP_LIMITED. A demand that is not a number sets
   ANHYST_DEMAND_LIMITED. */
ANHYST_REAL anhyst_compensator_solve_x(anhyst_compensator_x *c, ANHYST_REAL demand,
                                       ANHYST_REAL gap);

/* Advances the memory with the current that was applied, at the gap there was. Flags and cost are
   those of anhyst_compensator_commit_q31. A current beyond twice full scale counts as that. A
   current that is not finite sets ANHYST_CURRENT_LIMITED and leaves the memory alone. */
void anhyst_compensator_commit_x(anhyst_compensator_x *c, ANHYST_REAL applied, ANHYST_REAL gap);

/* The output that the model expects after the last commit. */
ANHYST_REAL
anhyst_compensator_output_x(const anhyst_compensator_x *c);

/* Number of ticks of the sequence that makes an unknown state known. */
int32_t anhyst_conditioning_length_x(const anhyst_compensator_x *c);

/* The current of its tick 0, 1, ...: triangles between the limits of the current; 0 after the
   end. Apply it and commit it as any other. */
ANHYST_REAL anhyst_conditioning_x(const anhyst_compensator_x *c, int32_t tick);

/* As anhyst_conditioning_step of compensator.h. */
ANHYST_REAL anhyst_conditioning_step_x(anhyst_compensator_x *c);

/* As anhyst_compensator_follows; a measured current that is not a number does not follow. */
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
