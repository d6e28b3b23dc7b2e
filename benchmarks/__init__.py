"""Benchmarks that anyone can repeat: `make bench`. Each module has a subject; `__main__` measures all, `report` writes
docs/performance.md."""

import app  # noqa: F401  # says where kernels are cached, which must come before numba
