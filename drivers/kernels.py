"""Compiled kernels for the tests: `python -m drivers.kernels` compiles each once, before the tests' workers need them.

A process for each core takes one number of joints after the other. At the end it leaves the mark of
`app.process.precompile`: with this mark nothing is compiled again, neither here nor by a server that a test starts.
"""

from __future__ import annotations

import gc
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import app  # noqa: F401  # says where kernels are cached, which must come before numba
from app.process.cores import usable_cores
from app.process.precompile import mark


def joints() -> list[int]:
    """Numbers of joints of the arms; those that take longest to compile come first."""
    from environments.catalogue import CATALOGUE

    return sorted({len(entry.rotor_inertia) for entry in CATALOGUE.values()}, reverse=True)


def compile_for(n: int) -> float:
    """Compile the kernels for an arm of n joints in every contact, and those that only tests call. Returns the time
    that it took, s."""
    import numpy as np

    from app.workers.precompile import compiled
    from controllers.reference_estimates import FeedforwardModel

    began = time.monotonic()
    gc.disable()  # a collection finds little of what the compiler makes, and all of them took a tenth of the time
    for loop in compiled(n):
        system, F = loop.system, np.zeros(6)
        q, q_dot = system.q_0, 0.0 * system.q_0
        estimate, task = system.observe(q, q_dot, 0.0)
        system.controller.evaluate(
            q_dot, system.reference(0.0), task, estimate, FeedforwardModel.at(estimate), q, q_dot, F
        )
    gc.collect()
    return time.monotonic() - began


def main() -> None:
    """Compile, and leave the mark."""
    if mark().exists():
        return
    began = time.monotonic()
    with ProcessPoolExecutor(usable_cores(), mp_context=get_context("spawn")) as pool:
        for n, took in zip(joints(), pool.map(compile_for, joints()), strict=True):
            print(f"drivers.kernels: {n} joints, {took:.0f} s", flush=True)
    mark().touch()
    print(f"drivers.kernels: compiled in {time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())
