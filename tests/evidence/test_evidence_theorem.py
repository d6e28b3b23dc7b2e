"""The sections theorem, closed_forms and convergence of the evidence, on few of their cases: what they claim holds."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from app.evidence import arms, closed_forms, convergence, theorem
from app.evidence.adversary import Hunt
from app.evidence.arms import DrawnPlant, Outside, Reaching, RefusedPlant
from app.evidence.closed_form_runs import (
    MeasuredForceLoop,
    MeasuredOscillation,
    MeasuredStart,
    Multiplier,
    Response,
    SteadyState,
    changed,
    recovered,
)
from app.evidence.plants import drawn
from app.evidence.section import EvidenceSection
from app.export.figures import Curve, Figure, FigureChart
from app.export.printing import render
from app.scenario.data import shipped
from app.scenario.declared_bounds import outside
from app.scenario.departures import Departure
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN
from app.session.headless_run import simulate

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("compiled")]  # long or many simulations


def run(section: EvidenceSection, thin: int) -> list[Any]:
    """The results of few jobs; every name in the prose has its number, table or figure."""
    results = [job.function(*job.arguments) for job in section.jobs(thin)]
    assert section.text(section.conclude(results), "evidence").startswith(section.heading)
    return results


def test_departures_end_at_the_edge_of_what_is_declared() -> None:
    scenario, random = drawn("ur5", "hybrid", 0, 0), np.random.default_rng(0)

    def at(departure: Departure, scale: float) -> Scenario:
        return msgspec.structs.replace(scenario, truth=departure.truth(scenario.declared, scale))

    assert not any(outside(at(Departure.inside(random, 6), 1.0), CARTESIAN) for _ in range(50))
    corner = Departure.edge(random, 6)
    assert not outside(at(corner, 1.0), CARTESIAN)
    assert len(outside(at(corner, 1.01), CARTESIAN)) == 9


def test_what_is_promised_inside_is_kept_and_breaks_outside() -> None:
    results = run(theorem.SECTION, thin=70)
    batches = [one for batch in results if isinstance(batch, list) for one in batch]
    plants = [one for one in batches if isinstance(one, DrawnPlant)]
    promised = [one for one in plants if isinstance(one, Reaching) and one.promised_fraction > 0.0]
    away = [one for one in batches if isinstance(one, Outside)] + arms.outside("ur5", "hybrid", 0)
    hunts = [one for one in results if isinstance(one, Hunt)]
    assert {one.bounds for one in plants} == {"tight", "paper"}
    assert len(promised) >= 3
    for one in plants:
        assert one.verdict != "broken"
        assert bool(isinstance(one, RefusedPlant) or one.failed or one.stopped) == (one.verdict == "nothing promised")
    for one in promised:
        assert one.excess <= 0.0
        assert not one.early_excess > 0.0
        assert not one.V_tightness > 1.0
        assert all(d.measured <= d.promised for d in (one.layer, one.band) if d is not None)
        if not one.lagging:
            assert one.used <= 1.0
            assert one.used_parts.max() <= 1.0 + 1e-9
            assert one.cause_fractions.sum() == pytest.approx(1.0)
    assert hunts
    for one in hunts:
        assert one.tries >= 25
        assert one.promised > 0
        assert one.broken == 0
        assert 0.0 < one.ratio <= 1.0
    assert all(not one.over_band > 1.0 for one in away if one.margin >= 0.0)
    assert not max(one.over_rest for one in away) > 1.0
    assert any(one.margin < 0.0 for one in away)


def test_runs_follow_the_closed_forms() -> None:
    results = run(closed_forms.SECTION, thin=9)
    kinds = {list, Response, MeasuredStart, MeasuredOscillation, MeasuredForceLoop, Multiplier}
    assert {type(one) for one in results} == kinds
    rests = [one for batch in results if isinstance(batch, list) for one in batch]
    assert len(rests) == 16
    for one in rests:
        assert isinstance(one, SteadyState)
        assert one.e_fn == pytest.approx(one.e_fn_expected, abs=1e-6)
        assert one.e_rf == pytest.approx(one.e_rf_expected, abs=1e-9)
    assert max(abs(one.e_fn) for one in rests) > 10.0
    for one in results:
        match one:
            case Response():
                assert one.error < 0.03 * one.period
            case MeasuredStart():
                if one.choice == "remove":
                    assert one.s_0 < 1e-12
                    assert one.largest < 1.0
            case MeasuredOscillation():
                omega, zeta = one.found
                assert omega == pytest.approx(one.omega, rel=0.02 if one.scale == 1.0 else 0.004)
                assert zeta == pytest.approx(one.zeta, abs=0.01 if one.scale == 1.0 else 0.002)
            case MeasuredForceLoop():
                assert one.found == pytest.approx(one.factor, abs=5e-3)
            case Multiplier():
                assert one.phi < 1e-12
                assert one.error < (0.003 if one.reading == "solved" else 40.0 * one.period)
            case list():
                pass  # of rests, above
            case _:
                raise AssertionError(one)


def test_orders_of_convergence() -> None:
    for one in run(convergence.SECTION, thin=5):
        assert one.slope == pytest.approx(one.expected, rel=0.1)


def test_solved_multiplier_misses_by_M_s_dot() -> None:
    """(14) with e_rf = 0: lambda - lambda_d = M_m1 ds_1/dt, where A = 0."""
    scenario = changed(
        shipped()["ur5-constrained"],
        force={"kind": "sinusoid", "value": 20.0, "amplitude": 5.0, "frequency": 1.0},
        sensor={"ideal": True},
        simulation={"duration": 0.5},
    )
    loop, _ = simulate(scenario)
    record = loop.recording.signals(("t", "s", "multiplier", "F_cd"), t_from=0.2)
    s_dot = np.diff(record["s"][:, 0]) / np.diff(record["t"])
    error = (record["multiplier"] - record["F_cd"][:, 0])[:-1]
    assert np.abs(error).max() > 1e-3
    np.testing.assert_allclose(error, loop.system.controller.model.M_m[0, 0] * s_dot, atol=0.02 * np.abs(error).max())


@pytest.mark.parametrize(("omega", "zeta"), [(3.0, 0.05), (20.0, 0.7), (31.6, 0.95)])
def test_oscillations_are_recovered(omega: float, zeta: float) -> None:
    t = np.arange(0.0, 5.0 / (zeta * omega), 1e-3)
    omega_d = omega * np.sqrt(1.0 - zeta**2)
    response = -0.01 * np.exp(-zeta * omega * t) * np.cos(omega_d * t + 0.3)
    assert recovered(t, response) == pytest.approx((omega, zeta), rel=1e-5)


def test_orders_are_drawn_on_logarithmic_axes() -> None:
    steps = np.array([1e-6, 1e-4, 1e-2])
    curve = Curve("measured", (66, 135, 245), steps, steps, width=0.0, dotted=True)
    chart = FigureChart("order", "rad", (curve,), x_label="step [s]", logarithmic=True, logarithmic_x=True)
    drawing = render(Figure((chart,), ""), "svg").decode()
    assert drawing.count(">10⁻⁶<") == 2
    assert drawing.count(">10⁻²<") == 2
