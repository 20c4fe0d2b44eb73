/* SPDX-License-Identifier: Apache-2.0 */

/* A material in physical units. */
typedef struct {
  ANHYST_NAME(anhyst_operator) law;
  ANHYST_REAL saturation;  /* M_s, A/m */
  ANHYST_REAL shape;       /* a, A/m */
  ANHYST_REAL interaction; /* alpha, below 1 */
} ANHYST_NAME(anhyst_iron);

/* The circuit around the iron at one sample. All zero: the drive is the field itself. */
typedef struct {
  ANHYST_REAL gap_ratio; /* rho: reluctance of the gap over that of an air-filled iron path, >= 0 */
  ANHYST_REAL eddy;      /* gamma/dt, A/(m T): opposing field per change of flux density, >= 0 */
} ANHYST_NAME(anhyst_circuit);

/* A solution that has not been committed. */
typedef struct {
  ANHYST_NAME(anhyst_state) state;
  ANHYST_REAL drive; /* c_H*I, or the applied field, A/m */
  ANHYST_REAL field; /* in the iron, A/m */
  ANHYST_REAL flux;  /* flux density B, T */
} ANHYST_NAME(anhyst_reaction);

/* Fills an iron from physical parameters; k, r_d in A/m. The branch may be null unless step is
   exact, and must outlive the iron. Returns ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status ANHYST_NAME(anhyst_iron_init)(ANHYST_NAME(anhyst_iron) *iron, anhyst_step step,
                                            ANHYST_REAL saturation, ANHYST_REAL shape,
                                            ANHYST_REAL pinning, ANHYST_REAL reversibility,
                                            ANHYST_REAL interaction, ANHYST_REAL play_width,
                                            const ANHYST_NAME(anhyst_branch) *branch);

/* Flux density of a state, T. */
ANHYST_REAL ANHYST_NAME(anhyst_flux_of)(const ANHYST_NAME(anhyst_iron) *iron,
                                        const ANHYST_NAME(anhyst_state) *state);

/* Drive given: x + (R/(1+R) - alpha)*M = (drive + eddy*B0)/(1+R), R = rho + eddy*mu0; backward
   Euler for the eddy field gamma*dB/dt. The state is not touched; status as anhyst_solve. */
anhyst_status ANHYST_NAME(anhyst_forward)(const ANHYST_NAME(anhyst_iron) *iron,
                                          const ANHYST_NAME(anhyst_state) *state,
                                          const ANHYST_NAME(anhyst_circuit) *circuit,
                                          ANHYST_REAL drive,
                                          ANHYST_NAME(anhyst_reaction) *reaction);

/* Flux density given: x + (1-alpha)*M = B/mu0, then
   drive = x - alpha*M + rho*B/mu0 + eddy*(B - B0). The state is not touched. */
anhyst_status ANHYST_NAME(anhyst_inverse)(const ANHYST_NAME(anhyst_iron) *iron,
                                          const ANHYST_NAME(anhyst_state) *state,
                                          const ANHYST_NAME(anhyst_circuit) *circuit,
                                          ANHYST_REAL flux, ANHYST_NAME(anhyst_reaction) *reaction);

/* Advances the state with the drive that was really applied (after limits and the amplifier).
   On failure the state is unchanged. */
anhyst_status ANHYST_NAME(anhyst_commit)(const ANHYST_NAME(anhyst_iron) *iron,
                                         ANHYST_NAME(anhyst_state) *state,
                                         const ANHYST_NAME(anhyst_circuit) *circuit,
                                         ANHYST_REAL applied_drive);

/* A whole record: for each of n samples the given quantity in given[i] and the circuit in rho[i],
   eddy[i]; with inverse = 0 the given one is the drive and found[i] the flux density, otherwise the
   other way round. field[i] is the field in the iron. The state is advanced. On failure *index is
   the sample, and the state that of the last good one. */
anhyst_status ANHYST_NAME(anhyst_record)(const ANHYST_NAME(anhyst_iron) *iron,
                                         ANHYST_NAME(anhyst_state) *state, int inverse, size_t n,
                                         const ANHYST_REAL *given, const ANHYST_REAL *rho,
                                         const ANHYST_REAL *eddy, ANHYST_REAL *found,
                                         ANHYST_REAL *field, size_t *index);

/* Repeats a cycle of n samples until x, y and p return within tol (in units of a and M_s) after one
   repetition; every fourth repetition is used to extrapolate, since the law creeps geometrically.
   The state is then that of the settled cycle before its first sample; *cycles counts the
   repetitions. Returns ANHYST_NOT_SETTLED after most_cycles. */
anhyst_status ANHYST_NAME(anhyst_settle)(const ANHYST_NAME(anhyst_iron) *iron,
                                         ANHYST_NAME(anhyst_state) *state, int inverse, size_t n,
                                         const ANHYST_REAL *given, const ANHYST_REAL *rho,
                                         const ANHYST_REAL *eddy, ANHYST_REAL tol, int most_cycles,
                                         int *cycles, size_t *index);
