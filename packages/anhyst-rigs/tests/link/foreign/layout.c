/* Variables with initial values, for the reader of ELF files; nothing runs this program. */

#include <stdint.h>

typedef enum { IDLE = -1, RUN = 3 } state_t;
typedef int16_t row_t[2];

struct item {
  row_t rows[2];
  struct {
    uint8_t first, second;
  };
  union {
    float value;
    uint32_t bits;
  } any;
};

struct outer {
  uint32_t wide : 20;
  int32_t signed_bits : 7;
  uint32_t last : 5;
  struct item items[3];
  double far;
};

struct outer a = {
    .wide = 0xABCDE,
    .signed_bits = -33,
    .last = 21,
    .items = {{{{1, 2}, {3, 4}}, {5, 6}, {1.25f}},
              {{{7, 8}, {9, 10}}, {11, 12}, {-2.5f}},
              {{{13, 14}, {-15, 16}}, {17, 18}, {3.5f}}},
    .far = -1e-9,
};
state_t state = RUN, other = IDLE;
_Bool flag = 1;
int8_t small = -7;
int64_t large = -5000000000;
const volatile float calibration = 0.75f;
const int32_t fixed = 42;
int *pointer = (int *)&small;
uint8_t too_many[5000];
static volatile uint16_t hidden = 513;

void _start(void)
{
  hidden++;
  for (;;) {
  }
}
