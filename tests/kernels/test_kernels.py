"""What compiled functions rely on: small algebra, records, and that no part of another arm's kernel is ever called."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import namedtuple
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, types
from numba.core.caching import IndexDataCacheFile
from numba.core.errors import NumbaError

from app.scenario.data import load
from app.simulation.closed_loop import ClosedLoop
from app.simulation.period.control_period import control_period
from app.simulation.signals import Row
from kernels import algebra, allocating, inline, kernel, not_kept, symbols
from kernels.linking import LinkedLibrary
from kernels.records import Record


def from_python(part: Callable) -> Callable:
    """A part, which only kernels may call."""
    return njit(lambda *arguments: part(*arguments))


def in_records(part: Callable) -> Callable:
    """A part whose arguments are arrays within records, as a function of arrays by themselves."""
    calls = {
        1: njit(lambda x: part(x[0].a)),
        3: njit(lambda x: part(x[0].a, x[0].b, x[0].c)),
        4: njit(lambda x: part(x[0].a, x[0].b, x[0].c, x[0].d)),
    }

    def call(*arrays: np.ndarray) -> float | None:
        record = Record(namedtuple("Arguments", list("abcd")[: len(arrays)])(*arrays))
        found = calls[len(arrays)](record.data)
        for array, result in zip(arrays, record.read(), strict=True):
            array[...] = result
        return found

    return call


cross, norm_of_product, quadratic, solve_spd, times = (
    from_python(getattr(algebra, name)) for name in ("cross", "norm_of_product", "quadratic", "solve_spd", "times")
)
congruence, invert, multiply, spectral_norm, transposed_multiply, transposed_times = (
    in_records(getattr(algebra, name))
    for name in ("congruence", "invert", "multiply", "spectral_norm", "transposed_multiply", "transposed_times")
)


def room(*shape: int) -> np.ndarray:
    return np.full(shape, np.nan)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 7])
def test_algebra(n: int) -> None:
    random = np.random.default_rng(n)
    for _ in range(50):
        A, B = random.standard_normal((2, n, n)) * 10 ** random.uniform(-2, 2)
        C, x = random.standard_normal((3, n)), random.standard_normal(n)
        spd = A @ A.T + 0.1 * np.eye(n)
        out, tall, vector, space, work = room(n, n), room(3, n), room(n), room(3), room(n, n)
        multiply(A, B, out)
        np.testing.assert_allclose(out, A @ B, rtol=1e-9, atol=1e-9)
        multiply(C, A, tall)
        np.testing.assert_allclose(tall, C @ A, rtol=1e-9, atol=1e-9)
        times(C, x, space)
        np.testing.assert_allclose(space, C @ x, rtol=1e-9, atol=1e-9)
        transposed_times(C, space, vector)
        np.testing.assert_allclose(vector, C.T @ space, rtol=1e-9, atol=1e-9)
        transposed_multiply(A, B, out)
        np.testing.assert_allclose(out, A.T @ B, rtol=1e-9, atol=1e-9)
        congruence(A, spd, work, out)
        np.testing.assert_allclose(out, A.T @ spd @ A, rtol=1e-8, atol=1e-8)
        invert(A, work, out)
        np.testing.assert_allclose(out, np.linalg.inv(A), rtol=1e-6, atol=1e-9)
        solve_spd(spd, x, work, vector)
        np.testing.assert_allclose(vector, np.linalg.solve(spd, x), rtol=1e-6, atol=1e-9)
        assert quadratic(x, A) == pytest.approx(x @ A @ x)
        assert norm_of_product(C, x) == pytest.approx(np.linalg.norm(C @ x))


def test_algebra_at_its_borders() -> None:
    with pytest.raises(ValueError, match="singular"):
        invert(np.ones((2, 2)), room(2, 2), room(2, 2))
    swapped = room(2, 2)
    invert(np.array([[0.0, 2.0], [4.0, 0.0]]), room(2, 2), swapped)
    assert np.array_equal(swapped, [[0.0, 0.25], [0.5, 0.0]])
    a, b = np.random.default_rng(0).standard_normal((2, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b))


@pytest.mark.parametrize("decorated", [kernel, inline, allocating])
def test_only_an_allocating_kernel_makes_new_arrays(decorated: Callable) -> None:
    """The others count no references, which took a fifth of a period."""

    @decorated
    def doubled(x, out):
        out[:] = 2.0 * x

    @not_kept
    def called(x, out):
        doubled(x, out)

    x, out = np.array([1.0, 2.0]), np.zeros(2)
    if decorated is allocating:
        called(x, out)
        assert out.tolist() == [2.0, 4.0]
    else:
        with pytest.raises(NumbaError, match="NRT required but not enabled"):
            called(x, out)


def test_a_new_array_is_returned_to_an_allocating_kernel_only() -> None:
    """Without counted references nobody would free it."""

    @allocating
    def doubled(x):
        return 2.0 * x

    def first_of_doubled(x):
        return doubled(x)[0]

    calls = []
    for decorated in (allocating, inline):
        part = decorated(first_of_doubled)
        calls.append(njit(lambda x, part=part: part(x)))
    assert calls[0](np.array([1.5])) == 3.0
    with pytest.raises(NumbaError, match="NRT required but not enabled"):
        calls[1](np.array([1.5]))


class Inner(NamedTuple):
    a: np.ndarray
    count: int


class Outer(NamedTuple):
    inner: Inner
    x: float
    flag: bool


def test_record_is_one_memory_seen_by_name() -> None:
    record = Record(Outer(Inner(np.array([1.0, 2.0]), 3), 0.5, True))
    twin = record.copy()
    record.data["inner"]["a"][0][1] = 7.0
    record.data["x"] = 2.5
    now = record.read()
    assert (now.inner.a.tolist(), now.inner.count, now.x, now.flag) == ([1.0, 7.0], 3, 2.5, True)
    now.inner.a[0] = 9.0
    assert record.views.inner.a.tolist() == [9.0, 7.0]
    assert twin.read().inner.a.tolist() == [1.0, 2.0]
    assert twin.data.dtype is record.data.dtype
    record.write("inner", Inner(np.zeros(2), 4))
    assert record.read().inner.count == record.part("inner").count == 4
    assert record.data.dtype is Record(Outer(Inner(np.zeros(2), 1), 0.0, False)).data.dtype


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-impedance", "planar2r-semicircle"])
def test_nothing_of_the_last_period_leaks_into_this_one(name: str) -> None:
    """Whatever the memory between input and output holds, the row is the same."""
    loop = ClosedLoop.from_scenario(load(name))
    for _ in range(20):
        loop.step()
    rows = []
    for garbage in (0.0, 1e3):
        evaluation = loop.state.evaluation.copy()
        for part in ("seen", "reference", "feedforward", "output"):
            evaluation.data[part].view(np.float64)[:] = garbage
        row, arm = Record(Row.zeros(loop.recording.n)).data, loop.state.arm
        row.view(float)[:] = np.nan
        terms = loop.system.nominal.update(arm.views.q, arm.views.q_dot)
        control_period(
            loop.controlled_arm.settings.data, evaluation.data, *terms, arm.data, arm.views.load.wrench, loop.t, row
        )
        rows.append(row.view(float))
    assert np.isfinite(rows[0]).all()
    assert np.array_equal(*rows)


SIZED = """
import sys
from typing import NamedTuple
import numpy as np
from kernels import kernel, inline
from kernels.records import Record

class Vector(NamedTuple):
    x: np.ndarray

@inline
def total(x):
    s = 0.0
    for i in range(x.shape[0]):
        s += x[i]
    return s

@kernel
def summed(vector):
    return total(vector[0].x)

def answers(sizes):
    return [summed(Record(Vector(np.ones(n))).data) for n in sizes]
"""

CHOSEN = """
import numpy as np
from kernels import choice, kernel, inline

@inline
def plus(x, out):
    for i in range(x.shape[0]):
        out[i] = x[i] + 7.0

@inline
def minus(x, out):
    for i in range(x.shape[0]):
        out[i] = x[i] - 7.0

_up, _down = choice((plus, minus)), choice((minus, plus))

@kernel
def up(number, x, out):
    _up(number, x, out)

@kernel
def down(number, x, out):
    _down(number, x, out)

def answers(names):
    out = np.zeros(3)
    def answer(name, number):
        globals()[name](number, np.zeros(3), out)
        return out[0]
    return [answer(name, number) for name in names for number in (0, 1)]
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "alone", "together"),
    [
        (SIZED, {(6,): [6.0], (7,): [7.0], (3,): [3.0]}, (3, 6, 7)),
        (CHOSEN, {("up",): [7.0, -7.0], ("down",): [-7.0, 7.0]}, ("down", "up")),
    ],
    ids=["of two sizes", "made of other parts"],
)
def test_kernels_from_the_cache_of_two_processes(
    tmp_path: Path, module: str, alone: dict[tuple, list[float]], together: tuple
) -> None:
    """numba's own names for compiled functions made one size, or one choice, call the parts of another."""
    (tmp_path / "kept.py").write_text(module)
    root = Path(__file__).parents[2]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": f"{tmp_path}:{root}"}

    def answers(asked: tuple) -> list[float]:
        command = [sys.executable, "-c", f"import kept; print(*kept.answers({asked}))"]
        told = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
        return [float(number) for number in told.split()]

    assert {asked: answers(asked) for asked in alone} == alone
    assert answers(together) == [number for part in together for number in alone[(part,)]]


def test_a_kernel_that_only_kernels_call_has_no_code_of_its_own_and_raises_through_its_callers() -> None:
    @inline
    def root(x):
        if x < 0.0:
            raise ValueError("no real root")
        return np.sqrt(x)

    of_sum = njit(lambda x, y: root(x + y))
    assert of_sum(7.0, 2.0) == 3.0
    with pytest.raises(ValueError, match="no real root"):
        of_sum(1.0, -2.0)
    alone = root.dispatcher.overloads[(types.float64,)]
    assert isinstance(alone.library, LinkedLibrary)
    assert not alone.library.get_pointer_to_function(alone.fndesc.llvm_func_name)


def test_a_cache_that_is_filled_by_many_at_once_loses_and_confuses_nothing(tmp_path: Path) -> None:
    assert IndexDataCacheFile.save is symbols._save_alone
    keys = [str(number) for number in range(200)]

    def save(key: str) -> None:
        IndexDataCacheFile(str(tmp_path), "function", "stamp").save(key, f"code for {key}")

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(save, keys))
    kept = IndexDataCacheFile(str(tmp_path), "function", "stamp")
    assert {key: kept.load(key) for key in keys} == {key: f"code for {key}" for key in keys}


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (3, 2), (3, 6), (6, 6), (7, 7)])
def test_spectral_norm_is_never_below_and_at_most_a_little_above(shape: tuple[int, int]) -> None:
    random, k = np.random.default_rng(5), min(shape)
    # all singular values 1: the worst case
    alike = np.linalg.qr(random.standard_normal((max(shape), max(shape))))[0][: shape[0], : shape[1]]
    for A in (alike, 1e-9 * alike, 1e9 * alike, *random.standard_normal((50, *shape))):
        true = np.linalg.norm(A, 2)
        assert true * (1.0 - 1e-12) <= spectral_norm(A) <= true * k ** (1.0 / 64.0) * (1.0 + 1e-12)
    assert spectral_norm(np.zeros(shape)) == 0.0
    assert np.isnan(spectral_norm(np.full(shape, np.nan)))
