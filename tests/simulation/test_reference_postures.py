"""Postures along the reference: close together however long a run is to last, and none where the arm does not reach."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple, cast

import numpy as np
import pytest

from app.scenario.data import edited, shipped
from app.scenario.errors import PathOutOfReach, ScenarioError
from app.simulation.assembly import assemble
from app.simulation.omega.reference_postures import FAR, LARGEST_STEP, MOST, Observe, postures_along
from app.simulation.omega.search_memory import Memory
from app.simulation.period.planned_reference import Planned

LINE = {"kind": "line", "displacement": [0.0, 0.3, 0.0], "ramp": 0.0}


@pytest.mark.parametrize(
    ("motion", "duration"),
    [
        ({"kind": "circle"}, 10.0),
        ({"kind": "circle"}, 764.0),
        ({"kind": "circle"}, 2092.0),  # of 1023 intervals, each nearly half a period
        ({"kind": "point-to-point", "displacement": [0.2, 0.2, 0.0], "duration": 2.0}, 600.0),
        # the arm is at rest at the same place at the ends of all intervals
        (LINE | {"period": 0.5}, 95.5),
        (LINE | {"period": 2.0}, 2046.0),
    ],
)
def test_the_reference_is_near_a_centre_of_omega_at_every_instant(motion: dict[str, object], duration: float) -> None:
    scenario = edited(edited(shipped()["ur5-motion"], "motion", motion), "simulation.duration", duration)
    system = assemble(scenario, memory=Memory())
    omega, centres, instants = system.constants.omega, system.constants.centres, system.constants.instants
    assert len(centres) <= MOST
    random = np.random.default_rng(2)
    for t in (*np.arange(0.0, 6.0, 0.02), *random.uniform(0.0, duration, 300)):
        q = system.posture_at(centres[np.abs(instants - t).argmin()], t).q
        assert omega.centre_near(q).distance <= FAR * omega.radius, t


def test_estimates_along_a_reference_that_omega_does_not_join_are_refused() -> None:
    """The bound of their deviation needs a way within Omega."""
    scenario = edited(shipped()["ur5-motion"], "controller.estimates", "along-reference")
    assemble(scenario, memory=Memory())
    with pytest.raises(ScenarioError, match=r"controller\.estimates: 'along-reference', with postures .* apart"):
        assemble(edited(scenario, "simulation.domain_radius", 1e-4), memory=Memory())


class _Plain(NamedTuple):
    """Observation of an arm with one joint, as far as it is read."""

    r: np.ndarray
    J_q_inv: np.ndarray = np.eye(1)
    turn: np.ndarray = np.zeros(1)

    @property
    def views(self) -> SimpleNamespace:
        return SimpleNamespace(task=self)


@pytest.mark.parametrize("beyond", np.geomspace(1e-5, 1e-3, 6))
def test_no_posture_counts_that_is_not_on_the_path(beyond: float) -> None:
    """A pointer of 1 m whose height is to be a little more than that for 0.2 s."""

    def pointer(q: np.ndarray, _q_dot: np.ndarray, _t: float) -> _Plain:
        return _Plain(np.sin(q), np.array([[1.0 / np.cos(q[0])]]))

    def at(t: float) -> SimpleNamespace:
        return SimpleNamespace(r_d=np.array([(1.0 + beyond) * np.exp(-(max(abs(t - 5.0) - 0.1, 0.0) ** 2))]))

    with pytest.raises(PathOutOfReach):
        postures_along(
            cast(Observe, pointer), cast(Planned, SimpleNamespace(at=at)), np.zeros(1), np.zeros(1), 10.0, 1.0
        )


def test_a_motion_of_half_a_second_in_a_run_of_ten_minutes_is_followed() -> None:
    def at(t: float) -> SimpleNamespace:
        return SimpleNamespace(r_d=np.array([0.3 * np.exp(-(((t - 11.5) / 0.4) ** 2))]))

    found = postures_along(
        cast(Observe, lambda q, _q_dot, _t: _Plain(q)),
        cast(Planned, SimpleNamespace(at=at)),
        np.zeros(1),
        np.zeros(1),
        600.0,
        0.1,
    )
    assert found.q.max() > 0.25
    assert np.abs(np.diff(found.q[:, 0])).max() <= FAR * 0.1


@pytest.mark.parametrize("radius", [5e-324, 1e-9, 1e-4])
def test_an_omega_too_thin_to_be_covered_has_a_bounded_number_of_centres(radius: float) -> None:
    scenario = edited(shipped()["ur5-motion"], "simulation.domain_radius", radius)
    assert len(assemble(scenario, memory=Memory()).constants.centres) <= MOST


def test_a_wide_motion_in_a_run_of_ten_hours_is_followed() -> None:
    """Between two instants of so long a run the arm turns by more than a radian."""
    swing = {"kind": "line", "displacement": [0.0, 0.5, 0.0], "period": 137.0}
    scenario = edited(edited(shipped()["ur5-motion"], "motion", swing), "simulation.duration", 36000.0)
    system = assemble(scenario, memory=Memory())
    assert np.linalg.norm(np.diff(system.constants.centres, axis=0), axis=1).max() < LARGEST_STEP


@pytest.mark.parametrize("beyond", [-1e-3, *np.geomspace(1e-5, 3e-2, 12)])  # m
def test_a_path_that_ends_beyond_the_arms_reach_is_refused(beyond: float) -> None:
    """Newton's method alone ends near the arm stretched out, which is no posture on the path."""
    planar = edited(shipped()["ur5-motion"], "robot", {"name": "planar2r"})
    planar = edited(planar, "motion", {"kind": "point-to-point", "displacement": [0.01, 0.0], "duration": 2.0})
    system = assemble(planar, memory=Memory())
    tool, ahead, behind = (
        system.nominal.evaluate(np.array(q), np.zeros(2)).p[[0, 2]] for q in (system.q_0, (0.0, 0.0), (np.pi, 0.0))
    )
    shoulder, reach = 0.5 * (ahead + behind), 0.5 * float(np.linalg.norm(ahead - behind))
    outwards = (tool - shoulder) / np.linalg.norm(tool - shoulder)
    way = (reach + beyond) * outwards - (tool - shoulder)
    edge = edited(edited(planar, "motion.displacement", way.tolist()), "simulation.sigma_min", 0.0)
    if beyond < 0.0:
        assemble(edge, memory=Memory())
    else:
        with pytest.raises(PathOutOfReach):
            assemble(edge, memory=Memory())
