"""The command `bdnn`, one module a verb."""

import os

# the matrices are small: threads of a BLAS would only get in each other's way
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
