"""The command line: parse the options, call one function, print its result."""

import os

# Set before a BLAS library is loaded. The matrix products are small here, and BLAS threads would
# increase the processor time of an identification by half.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
