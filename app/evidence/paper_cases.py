"""Cases of the paper's conclusion, each under the discontinuous law (15) and with a boundary layer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.analysis.metrics import Account, account, force_error, motion_error
from app.analysis.spectrum import amplitude_spectrum
from app.evidence.drawing import charts_in_columns
from app.evidence.section import EvidenceSection, Findings, Job
from app.export.figures import FREQUENCY, TIME, Curve, FigureChart
from app.export.sheet import thinned
from app.process.markdown import Table
from app.scenario.data import edited, shipped
from app.session.headless_run import simulate

CASES = {
    "motion": ("trajectory of a UR5 in free space", "ur5-motion"),
    "moving": ("UR5 on an elastic surface that moves", "ur5-hybrid-moving"),
    "semicircle": ("planar 2R on a semicircle", "planar2r-semicircle"),
}
LAWS = {"discontinuous": (230, 159, 0), "saturation": (66, 135, 245)}
SETTLED = 2.0  # s, instant from which on figures count
POINTS = 600  # of a drawn curve


@dataclass(frozen=True)
class Run:
    """Run of one case under one law. curves: (x, y), by their chart. Metrics are from `SETTLED` on."""

    curves: dict[str, tuple[np.ndarray, np.ndarray]]
    account: Account
    torque_max: float  # N m, of any joint


def run(scenario: str, law: str, duration: float | None) -> Run:
    """Run of a case. Raises RuntimeError where it leaves the theorem's domain."""
    case = edited(shipped()[scenario], "controller.switching", law)
    if case.contact.nature.rigid:
        case = edited(case, "contact.unilateral", False)
    if duration is not None:
        case = edited(case, "simulation.duration", duration)
    loop, _ = simulate(case)
    if loop.stopped:
        raise RuntimeError(f"{scenario}, {law}: {loop.stopped}")
    record = loop.recording.signals(tuple(loop.recording.columns))
    t, tau = record["t"], record["tau"]
    settled = account(loop.system, loop.recording, SETTLED, loop.t)
    assert settled is not None, "every case lasts longer"
    few = slice(None, None, max(1, len(t) // (4 * POINTS)))
    error = np.linalg.norm(motion_error(loop.system, {name: values[few] for name, values in record.items()}), axis=1)
    late = t >= SETTLED
    spectrum = amplitude_spectrum(t[late], tau[late, :1]).thinned(POINTS)
    curves = {
        "error": (t[few], 1e3 * error),
        "s": (t, 1e3 * record["s_norm"]),
        "tau": (t, tau[:, 0]),
        "spectrum": (spectrum.frequency, spectrum.amplitude[:, 0]),
    }
    if loop.system.m:
        curves["force"] = (t, force_error(loop.system, record))
    drawn = {name: (x, y) if name == "spectrum" else thinned(x, y, POINTS) for name, (x, y) in curves.items()}
    return Run(drawn, settled, float(np.abs(tau[late]).max()))


def jobs(thin: int) -> list[Job]:
    duration = None if thin == 1 else 2 * SETTLED
    return [Job(run, (name, law, duration)) for _, name in CASES.values() for law in LAWS]


def conclude(results: Sequence[Run]) -> Findings:
    rows, figures = [], {}
    runs = iter(results)
    for case, (title, scenario) in CASES.items():
        of_law = {law: next(runs) for law in LAWS}
        rows += [(f"{title}, {law}", *_figures(found)) for law, found in of_law.items()]
        figures[case] = charts_in_columns(_charts(of_law), f"{title[0].upper()}{title[1:]}: scenario {scenario}.")
    header = (
        f"from t = {SETTLED:g} s on",
        "path error, largest [mm]",
        "force error, largest [N]",
        "‖s‖, largest [mm/s]",
        "residual of (8), RMS [N]",
        "torque, largest [N·m]",
        "torque variation [N·m/s]",
    )
    return Findings(tables={"cases": Table(header, rows)}, figures=figures)


def _figures(found: Run) -> tuple[str, ...]:
    of = found.account
    force = "" if of.force_max is None else f"{of.force_max:.3g}"
    s = "" if of.s_max is None else f"{1e3 * of.s_max:.3g}"
    numbers = (of.residual_rms, found.torque_max, of.variation)
    path = "" if of.path_max is None else f"{1e3 * of.path_max:.2g}"
    return path, force, s, *(f"{number:.3g}" for number in numbers)


def _charts(of_law: dict[str, Run]) -> tuple[FigureChart, ...]:
    shown = {
        "error": ("path error", "mm", True),
        "force": ("force error f_n − f_nd", "N", False),
        "s": ("‖s‖", "mm/s", True),
        "tau": ("torque of joint 1", "N·m", False),
        "spectrum": ("its amplitude spectrum", "N·m", True),
    }
    charts = []
    for name, (title, unit, logarithmic) in shown.items():
        if name not in next(iter(of_law.values())).curves:
            continue
        curves = tuple(
            Curve(law, color, *_positive(of_law[law].curves[name], logarithmic=logarithmic))
            for law, color in LAWS.items()
        )
        spectral = name == "spectrum"
        x_label = FREQUENCY if spectral else TIME
        charts.append(
            FigureChart(title, unit, curves, x_label=x_label, logarithmic=logarithmic, logarithmic_x=spectral)
        )
    return tuple(charts)


def _positive(xy: tuple[np.ndarray, np.ndarray], *, logarithmic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Curve with its smallest values raised above zero for a logarithmic axis."""
    x, y = xy
    return (x, np.maximum(y, 1e-5 * float(y.max()))) if logarithmic else (x, y)


SECTION = EvidenceSection("paper_cases", jobs, conclude)
