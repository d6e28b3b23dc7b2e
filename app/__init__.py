"""VSMRC Lab: scenarios, the closed loop, its runner, the command line and the dashboard."""

import os

# before numpy loads its BLAS: threads cost more than they bring for 6 x 6 matrices, and take cores from the loop
os.environ.setdefault("OMP_NUM_THREADS", "1")
