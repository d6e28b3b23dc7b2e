"""Measurements that anyone can repeat: `make bench`. One subject a module; `__main__` runs them, `report` writes."""

import app  # noqa: F401  # says where kernels are cached, which must come before numba
