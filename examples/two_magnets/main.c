/* SPDX-License-Identifier: Apache-2.0 */
/* Runs the golden vectors of both magnets at the same time and compares every current:

     ./two_magnets electromagnet/vectors.csv solenoid/vectors.csv */
#include <stdio.h>

#include "magnets.h"

static FILE *files[MAGNETS];
static int32_t demand[MAGNETS], gap[MAGNETS], applied[MAGNETS], expected[MAGNETS];

/* Reads a number and its separator. */
static int next_number(FILE *file, int32_t *number)
{
  long found;
  if (fscanf(file, "%ld%*c", &found) != 1) {
    return 0;
  }
  *number = (int32_t)found;
  return 1;
}

/* Reads the next row of each file. Returns 0 if a file has ended. */
static int next_rows(void)
{
  for (int i = 0; i < MAGNETS; i++) {
    if (!next_number(files[i], &demand[i]) || !next_number(files[i], &gap[i]) ||
        !next_number(files[i], &applied[i]) || !next_number(files[i], &expected[i])) {
      return 0;
    }
  }
  return 1;
}

int main(int count, char **arguments)
{
  long rows = 0;
  long wrong = 0;
  if (count != 1 + MAGNETS || !magnets_start()) {
    puts("usage: two_magnets FILE FILE (or the parameters are damaged)");
    return 2;
  }
  for (int i = 0; i < MAGNETS; i++) {
    files[i] = fopen(arguments[1 + i], "r");
    if (files[i] == NULL || fscanf(files[i], "%*[^\n]") != 0) { /* column names */
      perror(arguments[1 + i]);
      return 2;
    }
  }
  while (next_rows()) {
    int32_t current[MAGNETS];
    rows++;
    magnets_solve(demand, gap, current);
    magnets_commit(applied, gap);
    for (int i = 0; i < MAGNETS; i++) {
      wrong += current[i] != expected[i];
    }
  }
  printf("%ld rows, %ld differ\n", rows, wrong);
  return rows == 0 || wrong > 0;
}
