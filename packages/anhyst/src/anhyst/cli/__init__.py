"""The command line: parse, call one function, print."""

import os

# Before anything loads a library of linear algebra: its products are small here, and threads that
# wait for each other cost identification half as much processor time again.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
