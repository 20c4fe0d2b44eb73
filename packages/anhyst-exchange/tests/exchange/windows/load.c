/* SPDX-License-Identifier: Apache-2.0 */
/* Loads a 64-bit Windows library into a Linux process and steps the FMU 2.0 in it.
 *
 * Arguments: library, token, step size, reference of an output. Standard input holds rows of the
 * first two inputs; each step prints a row with the output. */
#define _GNU_SOURCE
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define WINDOWS __attribute__((ms_abi))

/* Functions that the library imports from Windows, with the Windows calling convention. */
static WINDOWS void *its_calloc(size_t n, size_t size) { return calloc(n, size); }
static WINDOWS void *its_malloc(size_t size) { return malloc(size); }
static WINDOWS void its_free(void *place) { free(place); }
static WINDOWS double its_rint(double x) { return rint(x); }
static WINDOWS double its_floor(double x) { return floor(x); }
static WINDOWS double its_sqrt(double x) { return sqrt(x); }
static WINDOWS int its_memcmp(const void *a, const void *b, size_t n) { return memcmp(a, b, n); }
static WINDOWS void *its_memcpy(void *a, const void *b, size_t n) { return memcpy(a, b, n); }
static WINDOWS void *its_memset(void *a, int value, size_t n) { return memset(a, value, n); }
static WINDOWS int its_strcmp(const char *a, const char *b) { return strcmp(a, b); }
static WINDOWS char *its_strncpy(char *to, const char *from, size_t n)
{
  return strncpy(to, from, n);
}
static const struct {
  const char *name;
  uintptr_t place;
} known[] = {
    {"calloc", (uintptr_t)its_calloc},   {"malloc", (uintptr_t)its_malloc},
    {"free", (uintptr_t)its_free},       {"rint", (uintptr_t)its_rint},
    {"memcmp", (uintptr_t)its_memcmp},   {"memcpy", (uintptr_t)its_memcpy},
    {"memset", (uintptr_t)its_memset},   {"strcmp", (uintptr_t)its_strcmp},
    {"strncpy", (uintptr_t)its_strncpy}, {"floor", (uintptr_t)its_floor},
    {"sqrt", (uintptr_t)its_sqrt},
};

static unsigned char *base; /* image base */

static void leave(const char *why, const char *what)
{
  (void)fprintf(stderr, "%s %s\n", why, what);
  exit(1);
}

static uint32_t word(const unsigned char *at)
{
  uint32_t value;
  memcpy(&value, at, sizeof value);
  return value;
}

static uint64_t address(const unsigned char *at)
{
  uint64_t value;
  memcpy(&value, at, sizeof value);
  return value;
}

/* Copies headers and sections to their addresses; returns the optional header. */
static const unsigned char *place_sections(const unsigned char *file)
{
  const unsigned char *head = file + word(file + 0x3c);
  const unsigned char *optional = head + 24;
  const unsigned sections = word(head + 6) & 0xffffu;
  const unsigned char *section = optional + (word(head + 20) & 0xffffu);
  const size_t size = word(optional + 56);
  base = mmap(NULL, size, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (base == MAP_FAILED) {
    leave("no memory for", "the image");
  }
  memcpy(base, file, word(optional + 60));
  for (unsigned i = 0; i < sections; i++, section += 40) {
    const uint32_t given = word(section + 16), wanted = word(section + 8);
    memcpy(base + word(section + 12), file + word(section + 20), given < wanted ? given : wanted);
  }
  return base + word(file + 0x3c) + 24;
}

static void relocate(const unsigned char *optional)
{
  const uint64_t moved = (uint64_t)(uintptr_t)base - address(optional + 24);
  const unsigned char *block = base + word(optional + 112 + 8 * 5);
  const unsigned char *end = block + word(optional + 112 + 8 * 5 + 4);
  for (; block < end; block += word(block + 4)) {
    for (uint32_t i = 8; i < word(block + 4); i += 2) {
      const unsigned entry = block[i] | (unsigned)block[i + 1] << 8;
      unsigned char *at = base + word(block) + (entry & 0xfffu);
      if (entry >> 12 == 10) {
        const uint64_t value = address(at) + moved;
        memcpy(at, &value, sizeof value);
      }
    }
  }
}

static void import(const unsigned char *optional)
{
  const unsigned char *from = base + word(optional + 112 + 8);
  for (; word(from + 12) != 0; from += 20) {
    unsigned char *slot = base + word(from + 16);
    for (; address(slot) != 0; slot += 8) {
      const char *name = (const char *)base + address(slot) + 2;
      size_t i = 0;
      while (i < sizeof known / sizeof *known && strcmp(known[i].name, name) != 0) {
        i++;
      }
      if (i == sizeof known / sizeof *known) {
        leave("unknown function", name);
      }
      memcpy(slot, &known[i].place, sizeof known[i].place);
    }
  }
}

static uintptr_t exported(const char *wanted)
{
  const unsigned char *optional = base + word(base + 0x3c) + 24;
  const unsigned char *table = base + word(optional + 112);
  const unsigned char *functions = base + word(table + 28), *names = base + word(table + 32);
  const unsigned char *ordinals = base + word(table + 36);
  for (uint32_t i = 0; i < word(table + 24); i++) {
    if (strcmp((const char *)base + word(names + 4 * i), wanted) == 0) {
      const unsigned ordinal = ordinals[2 * i] | (unsigned)ordinals[2 * i + 1] << 8;
      return (uintptr_t)(base + word(functions + 4 * ordinal));
    }
  }
  leave("not exported:", wanted);
  return 0;
}

typedef WINDOWS void *instantiate(const char *, int, const char *, const char *, const void *, int,
                                  int);
typedef WINDOWS int plain(void *);
typedef WINDOWS int set_real(void *, const unsigned *, size_t, const double *);
typedef WINDOWS int get_real(void *, const unsigned *, size_t, double *);
typedef WINDOWS int do_step(void *, double, double, int);
#define EXPORTED(type, name) ((type *)exported("fmi2" name))

int main(int argc, char **argv)
{
  static unsigned char file[1 << 20];
  static const void *callbacks[5];
  static const unsigned inputs[] = {1, 2};
  unsigned output;
  double in[2], out, step, now = 0.0;
  FILE *stream = argc == 5 ? fopen(argv[1], "rb") : NULL;
  if (stream == NULL || fread(file, 1, sizeof file, stream) == sizeof file) {
    leave("cannot be read:", argc > 1 ? argv[1] : "nothing");
  }
  (void)fclose(stream);
  step = strtod(argv[3], NULL);
  output = (unsigned)strtoul(argv[4], NULL, 10);
  const unsigned char *optional = place_sections(file);
  relocate(optional);
  import(optional);
  if (word(optional + 16) != 0) {
    leave("there is an entry:", argv[1]);
  }
  void *made = EXPORTED(instantiate, "Instantiate")("one", 1, argv[2], "", callbacks, 0, 0);
  int wrong = made == NULL;
  wrong = wrong || EXPORTED(plain, "EnterInitializationMode")(made);
  wrong = wrong || EXPORTED(plain, "ExitInitializationMode")(made);
  while (!wrong && scanf("%lf %lf", &in[0], &in[1]) == 2) {
    wrong = EXPORTED(set_real, "SetReal")(made, inputs, 2, in) ||
            EXPORTED(do_step, "DoStep")(made, now, step, 0) ||
            EXPORTED(get_real, "GetReal")(made, &output, 1, &out);
    (void)printf("%.17g\n", out);
    now += step;
  }
  EXPORTED(plain, "FreeInstance")(made);
  return wrong;
}
