/* SPDX-License-Identifier: Apache-2.0 */
/* A slope of the full law where int has 16 bits: its product is more than ESBMC can bound in time.
   Its contract stands in proofs.toml and is put before it in the copy that is read. */
#include "full.c"
