/* SPDX-License-Identifier: Apache-2.0 */
/* Runs an S-function over rows of inputs and prints a row of outputs for each, as a fixed-step
   solver calls it. First line: inputs, outputs, sample time. An argument is the parameter. */
#include <stdio.h>
#include <stdlib.h>

static void leave_if_wrong(const SimStruct *S)
{
  if (S->error != NULL) {
    (void)printf("%s\n", S->error);
    exit(2);
  }
}

int main(int argc, char **argv)
{
  SimStruct block = {0};
  long k = 0;
  block.parameters_given = argc - 1;
  block.parameter = argc > 1 ? strtod(argv[1], NULL) : 0.0;
  mdlInitializeSizes(&block);
  leave_if_wrong(&block);
  if (block.parameters_wanted != block.parameters_given) {
    block.error = "wrong number of parameters";
    leave_if_wrong(&block);
  }
  mdlInitializeSampleTimes(&block);
  mdlStart(&block);
  leave_if_wrong(&block);
  (void)printf("%d %d %.17g\n", block.inputs, block.outputs, block.sample_time);
  for (;;) {
    int i;
    block.now = (double)k * block.sample_time;
    for (i = 0; i < block.inputs; i++) {
      if (scanf("%lf", &block.in[i]) != 1) {
        mdlTerminate(&block);
        return block.work == NULL ? 0 : 3;
      }
    }
    mdlOutputs(&block, 0);
    for (i = 0; i < block.outputs; i++) {
      (void)printf("%.17g%c", block.out[i], i + 1 < block.outputs ? ' ' : '\n');
    }
    mdlUpdate(&block, 0);
    leave_if_wrong(&block);
    k++;
  }
}
