/* The variables and options of the XCP slave for tests, and its memory. */

#include "slave.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Variables that a master reads and writes. `update` sets the signals at every event. */

typedef enum { MODE_OFF = 0, MODE_RUN = 1, MODE_FAULT = 7 } controller_mode;

struct inner {
  uint8_t count;
  int16_t level[3];
  float gain;
};

struct controller {
  struct inner axis[4];
  unsigned enabled : 1;
  signed trim : 5;
  unsigned speed : 10;
  controller_mode mode;
  union {
    float number;
    uint32_t code;
  } both;
  struct controller *next;
};

struct controller controller = {
    .axis = {{1, {10, 11, 12}, 0.25f},
             {2, {20, 21, 22}, 0.5f},
             {3, {30, 31, 32}, 0.75f},
             {4, {-40, 41, 42}, 1.5f}},
    .enabled = 1,
    .trim = -9,
    .speed = 777,
    .mode = MODE_FAULT,
};
uint32_t tick;
uint8_t sig_u8;
int8_t sig_i8;
uint16_t sig_u16;
int16_t sig_i16;
int32_t sig_i32;
uint64_t sig_u64;
int64_t sig_i64;
float sig_f32;
double sig_f64;
float par_gain = 2.5f;
double par_wide = 1e-3;
int16_t par_level = -100;
uint8_t par_flags = 0xA5;
uint32_t par_limited = 5;
int16_t table[2][3] = {{1, 2, 3}, {4, 5, 6}};
const float par_fixed = 9.5f;
static uint32_t bank[16] = {0xB0, 0xB1, 0xB2};

#define VARIABLE(name) {#name, &(name), sizeof(name)}
const struct variable variables[] = {
    VARIABLE(tick),
    VARIABLE(sig_u8),
    VARIABLE(sig_i8),
    VARIABLE(sig_u16),
    VARIABLE(sig_i16),
    VARIABLE(sig_i32),
    VARIABLE(sig_u64),
    VARIABLE(sig_i64),
    VARIABLE(sig_f32),
    VARIABLE(sig_f64),
    VARIABLE(par_gain),
    VARIABLE(par_wide),
    VARIABLE(par_level),
    VARIABLE(par_flags),
    VARIABLE(par_limited),
    {"table", table, 2},
    {"table_1", &table[0][1], 2},
    {"table_2", &table[0][2], 2},
};
const unsigned variable_count = COUNT(variables);

struct option options[] = {
    {"big", 0}, /* byte order of the protocol and of the memory: most significant byte first */
    {"granularity", 1}, /* bytes of an address */
    {"cto", 64},        /* MAX_CTO */
    {"dto", 64},        /* MAX_DTO */
    {"daq", 2},         /* 0: no DAQ lists; 1: static; 2: dynamic */
    {"identifier", 2},  /* bytes of the identification field, 1 to 4 */
    {"stamp", 4},       /* bytes of the time stamp: 0, 1, 2 or 4 */
    {"stamp_fixed", 0},
    {"entry_granularity", 1},
    {"max_entry", 8},
    {"one_extension", 0}, /* all entries of an ODT need the same address extension */
    {"period_us", 1000},
    {"stated_us", 0}, /* period that the slave states; 0: the true one */
    {"jitter_us", 0},
    {"locked", 0}, /* resources that are protected by seed and key */
    {"short_upload", 1},
    {"short_download", 1},
    {"event_info", 1},
    {"overload_bit", 0},
    {"lose_answer", 0}, /* every n-th answer is not sent */
    {"lose_sample", 0}, /* every n-th packet of samples is not sent */
    {"cut_answer", 0},  /* answers to SHORT_UPLOAD lack their last byte */
    {"cut_sample", 0},  /* packets of samples lack their last byte */
    {"busy", 0},        /* the first answer to each n-th command is ERR_CMD_BUSY */
    {"pending", 0}, /* EV_CMD_PENDING for 1.5 s before the answer to BUILD_CHECKSUM or DOWNLOAD */
};

const unsigned option_count = COUNT(options);

long option(const char *name)
{
  for (unsigned n = 0; n < COUNT(options); n++) {
    if (strcmp(options[n].name, name) == 0) {
      return options[n].value;
    }
  }
  fprintf(stderr, "no option %s\n", name);
  exit(1);
}

/* Memory. In the order "big", a variable appears with its bytes reversed. */

extern char __executable_start, _end;

static uint8_t *byte_at(unsigned extension, uint64_t address)
{
  if (extension == 1) {
    uint64_t offset = address - 0x100;
    return offset < sizeof(bank) ? (uint8_t *)bank + offset : NULL;
  }
  uint8_t *place = (uint8_t *)(uintptr_t)address;
  if (extension != 0 || place < (uint8_t *)&__executable_start || place >= (uint8_t *)&_end) {
    return NULL;
  }
  for (unsigned n = 0; option("big") && n < COUNT(variables); n++) {
    uint8_t *first = variables[n].place;
    if (place >= first && place < first + variables[n].size) {
      return first + (variables[n].size - 1 - (place - first));
    }
  }
  return place;
}

int read_memory(uint8_t *out, unsigned extension, uint64_t address, unsigned size)
{
  for (unsigned n = 0; n < size; n++) {
    uint8_t *place = byte_at(extension, address + n);
    if (place == NULL) {
      return 0;
    }
    out[n] = *place;
  }
  return 1;
}

int write_memory(const uint8_t *in, unsigned extension, uint64_t address, unsigned size)
{
  for (unsigned n = 0; n < size; n++) {
    uint8_t *place = byte_at(extension, address + n);
    if (place == NULL) {
      return 0;
    }
    *place = in[n];
  }
  if (par_limited > 10) {
    par_limited = 10;
  }
  return 1;
}

void update(uint32_t t)
{
  tick = t;
  sig_u8 = (uint8_t)t;
  sig_i8 = (int8_t)-(int)t;
  sig_u16 = (uint16_t)(3 * t);
  sig_i16 = (int16_t)(-3 * (int)t);
  sig_i32 = -100000 * (int32_t)(t % 10000);
  sig_u64 = 1000000007ull * t;
  sig_i64 = -1000000007ll * t;
  sig_f32 = 0.5f * (float)t;
  sig_f64 = -0.125 * t;
  bank[1] = 7 * t;
}

void put16(uint8_t *at, unsigned value)
{
  at[option("big") ? 1 : 0] = (uint8_t)value;
  at[option("big") ? 0 : 1] = (uint8_t)(value >> 8);
}

void put32(uint8_t *at, uint32_t value)
{
  put16(at + (option("big") ? 2 : 0), value & 0xFFFF);
  put16(at + (option("big") ? 0 : 2), value >> 16);
}

unsigned get16(const uint8_t *at)
{
  return option("big") ? (unsigned)(at[0] << 8 | at[1]) : (unsigned)(at[1] << 8 | at[0]);
}

uint32_t get32(const uint8_t *at)
{
  uint32_t first = get16(at), second = get16(at + 2);
  return option("big") ? first << 16 | second : second << 16 | first;
}
