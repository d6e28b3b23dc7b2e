"""VSMRC Lab: scenarios, the closed loop, its runner, the command line and the dashboard."""

import os

from app.process import kernel_cache

# before numpy loads its BLAS: threads cost more than they bring for 6 x 6 matrices, and take cores from the loop
os.environ.setdefault("OMP_NUM_THREADS", "1")
# LLVM's -O2 instead of numba's -O3: kernels are compiled in three quarters of the time, and are as fast
os.environ.setdefault("NUMBA_OPT", "2")
# before numba is imported: it looks only at a function's own file when it asks whether a cached kernel is still valid
kernel_cache.choose()
