/* The memory and the options of the XCP slave for tests. */

#ifndef SLAVE_H
#define SLAVE_H

#include <stdint.h>

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

struct variable {
  const char *name;
  void *place;
  unsigned size; /* bytes */
};

struct option {
  const char *name;
  long value;
};

extern const struct variable variables[];
extern const unsigned variable_count;
extern struct option options[];
extern const unsigned option_count;

extern const float par_fixed; /* cannot be written */

/* Returns the value of an option. */
long option(const char *name);

/* Copy bytes between a buffer and the memory; return 0 if an address is outside. */
int read_memory(uint8_t *out, unsigned extension, uint64_t address, unsigned size);
int write_memory(const uint8_t *in, unsigned extension, uint64_t address, unsigned size);

/* Write and read integers in the byte order of the slave. */
void put16(uint8_t *at, unsigned value);
void put32(uint8_t *at, uint32_t value);
unsigned get16(const uint8_t *at);
uint32_t get32(const uint8_t *at);

/* Sets all signals to their values at a tick. */
void update(uint32_t t);

#endif
