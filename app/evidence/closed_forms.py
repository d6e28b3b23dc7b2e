"""Comparison of runs with the paper's closed forms: (29), (35)-(37), Remark 2, (26), (42)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, get_args

import numpy as np

from app.evidence.closed_form_runs import (
    K_E,
    MeasuredForceLoop,
    MeasuredOscillation,
    MeasuredStart,
    Multiplier,
    Reading,
    Response,
    SteadyState,
    force_loop,
    free,
    multiplier,
    pressed,
    pressing,
    start,
    steady,
)
from app.evidence.drawing import charts_in_columns
from app.evidence.section import EvidenceSection, Findings, Job, of_kind
from app.export.figures import Curve, FigureChart
from app.process.markdown import Table
from app.scenario.data import shipped
from app.simulation.builders.controller_builder import law_of

STEADY_ROBOTS = ("ur5", "planar3r")
STIFFNESSES = (0.0, 1000.0, 3000.0, 10_000.0)  # K_m1, N/m
RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0)  # K_e_hat / K_e
FORCES = (8.0, 25.0)  # f_nd, N

PERIODS = (0.002, 0.001, 0.0005)  # s
MASSES = (0.0, 3.0)  # M_e, kg

FREE = tuple(product((5.0, 10.0, 20.0), (0.1, 0.3, 0.7)))  # omega rad/s, zeta
PRESSING = tuple(product((1000.0, 4000.0, 10_000.0), (0.1, 0.3, 0.7)))  # K_e N/m, zeta
SCALES = (1.0, 0.125)  # of the usual control period and boundary layer
FACTORS = (0.9, 0.5, -0.5, -0.9)  # of the sampled loop through the multiplier

READINGS: tuple[Reading, ...] = get_args(Reading)
CHOICES = ("remove", "watch")  # `controller.on_change`: Remark 2, or z(0) = 0
STEADY_CAPTION = "Lines: (37). Dots: where a UR5 and a planar 3R, both 15 % heavier than believed, come to rest."
CAPTION = "Colour: simulated. Dashed: the closed form."

BLUE, ORANGE, GREEN, PINK, BLACK = (66, 135, 245), (230, 159, 0), (0, 158, 115), (204, 121, 167), (0, 0, 0)


def jobs(thin: int) -> list[Job]:
    presses = list(product(RATIOS, FORCES))[::thin]
    robust = {name: scenario for name, scenario in shipped().items() if law_of(scenario).robust}
    shown = [name for name, scenario in robust.items() if scenario.controller.on_change == "remove"]
    return [
        *(Job(steady, (robot, K_m1, presses)) for robot in STEADY_ROBOTS for K_m1 in STIFFNESSES),
        *(Job(pressed, arguments) for arguments in product(MASSES, PERIODS)),
        *(Job(start, arguments) for arguments in product(shown[::thin], CHOICES)),
        *(Job(free, (*case, scale)) for case in FREE[::thin] for scale in SCALES),
        *(Job(pressing, (*case, scale)) for case in PRESSING[::thin] for scale in SCALES),
        *(Job(force_loop, (factor,)) for factor in FACTORS),
        *(Job(multiplier, arguments) for arguments in product(PERIODS, READINGS)),
    ]


def conclude(results: Sequence[Any]) -> Findings:
    rests = [one for batch in results if isinstance(batch, list) for one in batch]
    responses, starts = of_kind(Response, results), of_kind(MeasuredStart, results)
    oscillations, loops = of_kind(MeasuredOscillation, results), of_kind(MeasuredForceLoop, results)
    multipliers = of_kind(Multiplier, results)
    numbers = {
        "rests": f"{len(rests)}",
        "e_rf": f"{max(abs(one.e_rf - one.e_rf_expected) for one in rests):.1g}",
        "e_fn": f"{max(abs(one.e_fn - one.e_fn_expected) for one in rests):.1g}",
        "e_fn_zero": f"{max((abs(one.e_fn) for one in rests if one.K_m1 == 0.0), default=np.nan):.1g}",
        "e_fn_largest": f"{max(abs(one.e_fn) for one in rests):.3g}",
        "phi": f"{max(one.phi for one in multipliers):.1g}",
        "never_reaching": f"{max(one.largest for one in starts if one.choice == 'remove'):.2f}",
        "factor_error": f"{max(abs(one.found - one.factor) for one in loops):.1g}",
    }
    for scale, name in zip(SCALES, ("usual", "fine"), strict=True):
        found = [(one, *one.found) for one in oscillations if one.scale == scale]
        numbers[f"omega_{name}"] = f"{100 * max(abs(omega / one.omega - 1.0) for one, omega, _ in found):.2g}"
        numbers[f"zeta_{name}"] = f"{max(abs(zeta - one.zeta) for one, _, zeta in found):.1g}"
    return Findings(
        numbers=numbers,
        tables={
            "responses": _responses(responses),
            "starts": _starts(starts),
            "oscillations": _oscillations(oscillations),
            "loops": Table(
                ("M_m1 [kg]", "factor prescribed", "factor found"),
                [(f"{one.M_m1:.3g}", f"{one.factor:g}", f"{one.found:.4f}") for one in loops],
            ),
            "multipliers": Table(
                ("multiplier", "T [ms]", "\\|λ − λ_d\\|, largest [N]"),
                [(one.reading, f"{1e3 * one.period:g}", f"{one.error:.2g}") for one in multipliers],
            ),
        },
        figures={
            "steady": charts_in_columns((_steady_chart(rests),), STEADY_CAPTION),
            "responses": charts_in_columns(
                (_response_chart(responses), _oscillation_chart(oscillations), _loop_chart(loops)), CAPTION
            ),
        },
    )


def _responses(found: Sequence[Response]) -> Table:
    rows = []
    for M_e in MASSES:
        errors = [one.error for period in PERIODS for one in found if (one.M_e, one.period) == (M_e, period)]
        slope = np.polyfit(np.log(PERIODS), np.log(errors), 1)[0]
        rows.append((f"{M_e:g}", *(f"{1e6 * error:.3g}" for error in errors), f"{slope:.2f}"))
    return Table(("M_e [kg]", *(f"error at T = {1e3 * T:g} ms [µm]" for T in PERIODS), "slope"), rows)


def _starts(found: Sequence[MeasuredStart]) -> Table:
    rows = []
    for name in dict.fromkeys(one.name for one in found):
        removed, watched = (next(one for one in found if (one.name, one.choice) == (name, c)) for c in CHOICES)
        rows.append(
            (name, f"{1e3 * removed.s_0:.1g}", f"{removed.largest:.2f}", f"{1e3 * watched.s_0:.3g}",
             f"{1e3 * watched.reached:.3g}")
        )  # fmt: skip
    return Table(
        ("", "‖s(0)‖ [mm/s]", "largest ‖s‖ / band", "‖s(0)‖ with z(0) = 0 [mm/s]", "band then reached after [ms]"), rows
    )


def _oscillations(found: Sequence[MeasuredOscillation]) -> Table:
    rows = []
    for one in (one for one in found if one.scale == SCALES[0]):
        fine = next(
            o for o in found if (o.kind, o.omega, o.zeta, o.scale) == (one.kind, one.omega, one.zeta, SCALES[1])
        )
        pairs = (f"{number:.3f}" for way in (one, fine) for number in way.found)
        rows.append((one.kind, f"{one.omega:.2f}", f"{one.zeta:g}", *pairs))
    return Table(("response", "ω [rad/s]", "ζ", "ω at 1 ms", "ζ at 1 ms", "ω, an eighth", "ζ, an eighth"), rows)


def _steady_chart(found: Sequence[SteadyState]) -> FigureChart:
    ratios = np.geomspace(min(RATIOS), max(RATIOS), 60)
    curves = []
    for K_m1, color in zip(STIFFNESSES, (BLUE, ORANGE, GREEN, PINK), strict=True):
        expected = K_m1 / (K_m1 + K_E) * (1.0 - ratios) / ratios
        of = [one for one in found if one.K_m1 == K_m1]
        x, y = (np.array([getter(one) for one in of]) for getter in (lambda o: o.ratio, lambda o: o.e_fn / o.f_nd))
        curves.append(Curve(f"K_m1 = {K_m1:g} N/m", color, ratios, expected))
        curves.append(Curve("", color, x, y, width=0.0, listed=False, dotted=True))
    title = "steady force error over f_nd"
    return FigureChart(
        title, "ratio", tuple(curves), x_label="believed over true stiffness of the surface", logarithmic_x=True
    )


def _response_chart(found: Sequence[Response]) -> FigureChart:
    curves = []
    for M_e, color in zip(MASSES, (BLUE, ORANGE), strict=True):
        one = next(one for one in found if (one.M_e, one.period) == (M_e, PERIODS[-1]))
        curves.append(Curve(f"M_e = {M_e:g} kg", color, one.t, 1e3 * one.phi))
        curves.append(Curve("", BLACK, one.t, 1e3 * one.exact, dashed=True, width=0.7, listed=False))
    return FigureChart("penetration of an impedance, (29)", "mm", tuple(curves))


def _oscillation_chart(found: Sequence[MeasuredOscillation]) -> FigureChart:
    curves = []
    of = [
        one for one in found if one.kind.startswith("free") and one.scale == SCALES[0] and one.omega == found[0].omega
    ]
    for one, color in zip(of, (BLUE, ORANGE, GREEN), strict=False):
        sigma, omega_d = one.zeta * one.omega, one.omega * np.sqrt(1.0 - one.zeta**2)
        rate = (one.error[1] - one.error[0]) / (one.t[1] - one.t[0])
        exact = rate / omega_d * np.exp(-sigma * one.t) * np.sin(omega_d * one.t)
        curves.append(Curve(f"ω = {one.omega:g} rad/s, ζ = {one.zeta:g}", color, one.t, 1e3 * one.error))
        curves.append(Curve("", BLACK, one.t, 1e3 * exact, dashed=True, width=0.7, listed=False))
    return FigureChart("free error of an arm 15 % too heavy, (26)", "mm", tuple(curves))


def _loop_chart(found: Sequence[MeasuredForceLoop]) -> FigureChart:
    curves = []
    for one, color in zip(found, (BLUE, ORANGE, GREEN, PINK), strict=True):
        k = np.arange(len(one.error))
        curves.append(Curve("", BLACK, k, one.factor**k, width=0.5, dashed=True, listed=False))
        curves.append(Curve(f"factor {one.factor:g}", color, k, one.error / one.error[0], width=0.0, dotted=True))
    title = "rigid surface: λ − λ_d over its first value"
    return FigureChart(title, "ratio", tuple(curves), x_label="control period")


SECTION = EvidenceSection("closed_forms", jobs, conclude)
