"""Blends between target models: the note's example, certificates against eigenvalues, a blend in the loop."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.linalg import expm

from app.evidence.drawing import charts_in_columns
from app.evidence.regions import Region, Spot, render_regions
from app.evidence.section import EvidenceSection, Findings, Job
from app.export.figures import Curve, FigureChart
from app.export.sheet import thinned
from app.process.markdown import Table
from app.scenario.data import edited, from_plain, shipped, to_plain
from app.simulation.closed_loop import ClosedLoop
from controllers.blend import PIECES, axis_matrix, certify, shared_sliding
from controllers.dominance import hurwitz_on_hull, schur_on_hull
from controllers.target_model import TargetModel

NOTE = (np.array([[0.4, 0.4], [1.0, 0.2]]), np.array([[0.4, 0.4], [0.1, 0.9]]))
ALPHAS = np.linspace(0.0, 1.0, 401)
BLUE, ORANGE, GREEN, GREY = (66, 135, 245), (230, 159, 0), (60, 170, 110), (140, 140, 140)
BEGIN, OVER, END, AT_ONCE = 2.0, 2.0, 6.0, 0.001  # s: begin and length of the blend, end of the run, a control period
SOFT = {"M_m": [10.0] * 6, "B_m": [100.0] * 6, "K_m": [500.0] * 6}
POINTS = 600


def diagonal_lyapunov(A: np.ndarray) -> tuple[float, float]:
    """Interval of x in which v = y_1^2 + x y_2^2 falls along y_next = A y, for a Schur-stable A (2, 2): there the
    determinant of A^T D A - D, D = diag(1, x), a quadratic in x, is positive."""
    (a, b), (c, d) = A
    middle = (1.0 - a**2) * (1.0 - d**2) + (b * c) ** 2 - 2.0 * a * b * c * d
    low, high = np.sort(np.roots([c**2, -middle, b**2]).real)
    return float(low), float(high)


def disturbing() -> tuple[TargetModel, TargetModel]:
    """Two target models of two coordinates with an unstable blend, all their matrices s.p.d.

    M_m^-1 K_m is 100 [[1, 8], [0, 9]] in one and its mirror image 100 [[1, 0], [8, 9]] in the other: both have 10 and
    30 rad/s, zeta 2 and 2/3, but the determinant of the mean is negative.
    """
    M_0, M_1 = np.array([[10.0, -10.0], [-10.0, 20.0]]), np.array([[20.0, 10.0], [10.0, 10.0]])
    K_0, K_1 = np.array([[1e3, -1e3], [-1e3, 1e4]]), np.array([[1e4, 9e3], [9e3, 9e3]])
    return TargetModel(M_0, 40.0 * M_0, K_0, np.eye(2)), TargetModel(M_1, 40.0 * M_1, K_1, np.eye(2))


def metzler(seed: int, n: int, count: int) -> Counter[str]:
    """Count of the results of Theorem 4 for random pairs of Hurwitz-stable matrices (n, n), non-negative off the
    diagonal."""
    rng, found = np.random.default_rng(seed), Counter[str]()
    while found.total() < count:
        pair = rng.exponential(0.6 / n, (2, n, n))
        pair[:, range(n), range(n)] = -rng.uniform(0.1, 1.0, (2, n))
        if np.linalg.eigvals(pair).real.max() >= 0.0:
            continue
        certified = any(hurwitz_on_hull(A, by) for A in (list(pair), list(pair[::-1])) for by in ("rows", "columns"))
        worst = float(np.linalg.eigvals(pair[0] + ALPHAS[:, None, None] * (pair[1] - pair[0])).real.max())
        found[_verdict(certified, worst)] += 1
    return found


def decoupled(seed: int, count: int) -> Counter[str]:
    """Count of the certificate's results for random single axes: omega 3 to 60 rad/s, zeta 0.3 to 5."""
    rng, found = np.random.default_rng(seed), Counter[str]()
    for _ in range(count):
        omega, zeta = 10.0 ** rng.uniform(0.5, 1.8, 2), 10.0 ** rng.uniform(-0.5, 0.7, 2)
        models = [
            TargetModel(np.eye(1), np.diag([2 * z * w]), np.diag([w**2]), np.eye(1))
            for w, z in zip(omega, zeta, strict=True)
        ]
        found += _certified(models[0], models[1], np.zeros(1))
    return found


def coupled(seed: int, n: int, count: int) -> Counter[str]:
    """Count of the certificate's results for random coupled models, M_m, B_m, K_m s.p.d. with condition numbers up to
    some hundred; every second pair presses on 10 kN/m."""
    rng, found = np.random.default_rng(seed), Counter[str]()
    for number in range(count):
        models = [
            TargetModel(_spd(rng, n, 10.0), _spd(rng, n, 150.0), _spd(rng, n, 2000.0), np.eye(n)) for _ in range(2)
        ]
        K_e = np.zeros(n)
        K_e[0] = 1e4 * (number % 2)
        found += _certified(models[0], models[1], K_e)
    return found


def _spd(rng: np.random.Generator, n: int, size: float) -> np.ndarray:
    directions, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return size * directions @ np.diag(10.0 ** rng.uniform(-1.0, 1.0, n)) @ directions.T


def _certified(start: TargetModel, end: TargetModel, K_e: np.ndarray) -> Counter[str]:
    """Result of the certificate of one pair, compared with the eigenvalues at `SHARES`."""
    certificate = certify(start, end, np.diag(K_e))
    worst = max(_abscissas(start, end, K_e))
    found = Counter({"refused" if not certificate.stable else certificate.by: 1})
    found["wrong"] += worst > certificate.rightmost.at_most
    found["unseen"] += not certificate.stable and worst < 0.0
    return found


def _abscissas(start: TargetModel, end: TargetModel, K_e: np.ndarray) -> np.ndarray:
    """The largest real part of the poles at `SHARES`, 1/s, straight from the blend's definition."""
    n, sides = start.n, []
    for model in (start, end):
        M_inv = np.linalg.inv(model.M_m)
        low = np.hstack([-M_inv @ (model.K_m + model.K_f @ np.diag(K_e)), -M_inv @ model.B_m])
        sides.append(np.vstack([np.eye(n, 2 * n, n), low]))
    return np.linalg.eigvals(sides[0] + ALPHAS[:, None, None] * (sides[1] - sides[0])).real.max(axis=1)


def _verdict(certified: bool, worst: float) -> str:
    if certified:
        return "theorem 4" if worst < 0.0 else "wrong"
    return "stable" if worst < 0.0 else "unstable"


def swung(zeta: float) -> float:
    """Largest growth per cycle of an axis with damping zeta whose omega jumps back and forth between 10 and 20 rad/s,
    over all rhythms."""
    axes = [(2.0 * zeta * omega, omega**2) for omega in (10.0, 20.0)]
    sliding = shared_sliding(*axes)
    A = [axis_matrix(*axis, 0.0 if np.isnan(sliding) else sliding) for axis in axes]
    stays = np.linspace(0.01, 0.5, 50)
    after = [[expm(A_k * stay) for stay in stays] for A_k in A]
    return max(float(np.abs(np.linalg.eigvals(one @ other)).max()) for one in after[0] for other in after[1])


@dataclass(frozen=True)
class Blended:
    """Run of a UR5 that is pushed with 20 N while its model changes. curves: (x, y). Metrics are from `BEGIN` on."""

    curves: dict[str, tuple[np.ndarray, np.ndarray]]
    s_before: float  # m/s, largest in the second before
    s_max: float  # m/s
    s_step: float  # m/s, largest from one control period to the next
    residual: float  # N, RMS, of the model in force
    overshoot: float  # m, of the deflection beyond its last value


def pushed(over: float | None) -> Blended:
    """Run of the pushed UR5. over: length of the blend, s; None for an edit in place of the blend, at which z is set
    anew as in Remark 2."""
    data = to_plain(shipped()["ur5-impedance"])
    data |= {"contact": {"kind": "free"}, "motion": {"kind": "hold"}}
    data["truth"] |= {"push": [0.0, 20.0, 0.0], "push_start": 0.0, "push_duration": 100.0}
    data["simulation"]["duration"] = END
    if over is not None:
        data["blend"] = {"to": SOFT, "at": BEGIN, "over": over}
    loop = ClosedLoop.from_scenario(from_plain(data))
    period = loop.period
    for _ in range(round(BEGIN / period)):
        loop.step()
    if over is None:
        loop.edit(edited(loop.system.scenario, "target_model", SOFT))
    for _ in range(round((END - BEGIN) / period)):
        loop.step()
    record = loop.recording.signals(tuple(loop.recording.columns))
    t, since = record["t"], record["t"] >= BEGIN - 0.0015
    deflection = np.linalg.norm(record["e_r"][:, :3], axis=1)
    curves = {
        "deflection": (t, 1e3 * deflection),
        "s": (t, 1e3 * record["s_norm"]),
        "residual": (t, np.linalg.norm(record["residual"], axis=1)),
    }
    shown = {name: thinned(x[t > 1.0], y[t > 1.0], POINTS) for name, (x, y) in curves.items()}
    return Blended(
        shown,
        s_before=float(record["s_norm"][(t > BEGIN - 1.0) & (t < BEGIN - 0.001)].max()),
        s_max=float(record["s_norm"][since].max()),
        s_step=float(np.linalg.norm(np.diff(record["s"][since], axis=0), axis=1).max()),
        residual=float(np.sqrt((record["residual"][since] ** 2).sum(axis=1).mean())),
        overshoot=float(deflection.max() - deflection[-1]),
    )


WAYS = {
    f"blended over {OVER:g} s": (OVER, BLUE),
    "at once by an edit, z by Remark 2": (None, GREEN),
    "at once, z kept": (AT_ONCE, ORANGE),
}
SWINGING, CREEPING = 0.1, 1.5  # zeta
SIZES = (2, 3, 4, 6)


def jobs(thin: int) -> list[Job]:
    """Jobs of the section, the simulations first, since they take longest."""
    runs = [Job(pushed, (over,)) for over, _ in WAYS.values()]
    swings = [Job(swung, (zeta,)) for zeta in (SWINGING, CREEPING)]
    theorem = [Job(metzler, (seed, n, 4000 // thin)) for seed, n in enumerate((2, 3, 4))]
    axes = [Job(decoupled, (10, 4000 // thin))]
    models = [Job(coupled, (20 + half, n, max(2, 250 // thin))) for n in SIZES for half in range(2)]
    return runs + swings + theorem + axes + models


def conclude(results: Sequence[object]) -> Findings:
    found = iter(results)
    runs = dict(zip(WAYS, (_of(Blended, next(found)) for _ in WAYS), strict=True))
    swinging, creeping = (_of(float, next(found)) for _ in range(2))
    theorem = {n: _of(Counter, next(found)) for n in (2, 3, 4)}
    axes = _of(Counter, next(found))
    models = {n: _of(Counter, next(found)) + _of(Counter, next(found)) for n in SIZES}
    certificates = {"single axes": axes} | {f"{n} coupled coordinates": counts for n, counts in models.items()}
    start, end = disturbing()
    certificate = certify(start, end, np.zeros((2, 2)))
    (low_0, high_0), (low_1, high_1) = (diagonal_lyapunov(A) for A in NOTE)
    radii = [float(np.abs(np.linalg.eigvals(A)).max()) for A in NOTE]
    between = np.linalg.eigvals(NOTE[1] + ALPHAS[:, None, None] * (NOTE[0] - NOTE[1]))
    numbers = {
        "radius_0": f"{radii[0]:.4f}",
        "radius_1": f"{radii[1]:.4f}",
        "radius_between": f"{np.abs(between).max():.4f}",
        "certified": "certifies" if schur_on_hull(NOTE, "rows") else "does not certify",
        "lyapunov_0": f"{low_0:.4g} to {high_0:.4g}",
        "lyapunov_1": f"{low_1:.4g} to {high_1:.4g}",
        "wrong": str(sum(counts["wrong"] for counts in (*theorem.values(), *certificates.values()))),
        "pairs": str(sum(_total(counts) for counts in (*theorem.values(), *certificates.values()))),
        "unseen": str(sum(counts["unseen"] for counts in certificates.values())),
        "sentence": certificate.sentence,
        "swinging": f"{swinging:.3g}",
        "creeping": f"{creeping:.3g}",
        "zeta_swinging": f"{SWINGING:g}",
        "zeta_creeping": f"{CREEPING:g}",
        "pieces": f"{PIECES}",
    }
    return Findings(
        numbers,
        {"theorem": _theorem_table(theorem), "certificates": _table(certificates), "loop": _loop_table(runs)},
        {"note": _note_figure(), "refused": _refused_figure(), "loop": _loop_figure(runs)},
    )


T = TypeVar("T")


def _of(kind: type[T], result: object) -> T:
    assert isinstance(result, kind)
    return result


def _total(counts: Counter[str]) -> int:
    return counts.total() - counts["unseen"] - (0 if counts["stable"] + counts["unstable"] else counts["wrong"])


def _theorem_table(of_size: dict[int, Counter[str]]) -> Table:
    header = ("n × n", "certified", "of these unstable", "not certified, stable", "not certified, unstable")
    return Table(
        header,
        [
            (f"{n}", *(str(counts[name]) for name in ("theorem 4", "wrong", "stable", "unstable")))
            for n, counts in of_size.items()
        ],
    )


def _table(certificates: dict[str, Counter[str]]) -> Table:
    header = ("pairs of stable models", "by Theorem 4", "by eigenvalues", "refused", "promise broken")
    names = ("theorem 4", "eigenvalues", "refused", "wrong")
    return Table(header, [(title, *(str(counts[name]) for name in names)) for title, counts in certificates.items()])


def _loop_table(runs: dict[str, Blended]) -> Table:
    header = (
        "K_m from 2000 to 500 N/m",
        "‖s‖ before, largest [mm/s]",
        "‖s‖ from then on, largest [mm/s]",
        "its largest step [mm/s]",
        "residual of (8), RMS [N]",
        "overshoot [mm]",
    )
    rows = [
        (title, *(f"{x:.3g}" for x in (1e3 * r.s_before, 1e3 * r.s_max, 1e3 * r.s_step, r.residual, 1e3 * r.overshoot)))
        for title, r in runs.items()
    ]
    return Table(header, rows)


def _note_figure() -> bytes:
    """Fig. 1 of the note: a_11 = a_12 = 0.4, all entries >= 0."""
    (_, (c_0, d_0)), (_, (c_1, d_1)) = NOTE
    proportion = c_0 / (1.0 - d_0)  # I - A dominates I - A_0 rowwise where a_21 / (1 - a_22) is at most that
    bound = (1.0 - 0.4) / 0.4  # I - A is an M-matrix where a_21 / (1 - a_22) is below that
    hull = np.array([[0, 0], [c_0, 0], [c_0, d_0], [c_1, d_1], [0, d_1]])
    regions = (
        Region("stable: spectral radius below 1", GREY, np.array([[0, 0], [bound, 0], [0, 1]])),
        Region("each I − A here dominates I − A₀", BLUE, np.array([[0, 0], [proportion, 0], [0, 1]]), dashed=True),
        Region("Theorem 3: combinations of the two", BLUE, hull, filled=True),
        Region("Theorem 1: 0 ≤ A ≤ A₀", ORANGE, _box(c_0, d_0), filled=True),
        Region("Theorem 1: 0 ≤ A ≤ A₁", GREEN, _box(c_1, d_1), filled=True),
    )
    return render_regions(regions, (Spot("A₀", c_0, d_0), Spot("A₁", c_1, d_1)), "a₂₁", "a₂₂")


def _box(x: float, y: float) -> np.ndarray:
    return np.array([[0, 0], [x, 0], [x, y], [0, y]])


def _refused_figure() -> bytes:
    start, end = disturbing()
    curves = (
        Curve("rightmost pole of the blend", BLUE, ALPHAS, _abscissas(start, end, np.zeros(2))),
        Curve("0", GREY, ALPHAS, 0.0 * ALPHAS, dashed=True, listed=False),
    )
    chart = FigureChart("Two stable models, not so between them", "1/s", curves, x_label="α")
    return charts_in_columns((chart,), "The real part of the rightmost pole of (8) on the way between the two.")


def _loop_figure(runs: dict[str, Blended]) -> bytes:
    shown = {
        "deflection": ("deflection", "mm", 0.0),
        "s": ("‖s‖", "mm/s", 0.0),
        "residual": ("residual of (8), from 0.1 mN on", "N", 1e-4),
    }
    charts = []
    for name, (title, unit, least) in shown.items():
        curves = tuple(
            Curve(way, color, x, np.maximum(y, least), dashed=over == AT_ONCE, listed=name == "deflection")
            for (way, (over, color)), (x, y) in ((item, runs[item[0]].curves[name]) for item in WAYS.items())
        )
        charts.append(FigureChart(title, unit, curves, logarithmic=least > 0.0))
    caption = "UR5 pushed with 20 N; from t = 2 s on its stiffness falls to a quarter."
    return charts_in_columns(charts, caption)


SECTION = EvidenceSection("blend", jobs, conclude)
