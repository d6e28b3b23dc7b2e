"""What holds over Omega is not beaten by another search, longer and without derivatives; it is found once."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pinocchio as pin
import pytest

import app.simulation.omega.domain
from app.scenario.data import edited, from_plain, shipped
from app.scenario.departures import Departure
from app.scenario.errors import ScenarioError
from app.scenario.schema import Declared
from app.session.changes import on_robot
from app.simulation.assembly import assemble
from app.simulation.builders.environment_builder import truth_of
from app.simulation.omega.domain import MARGIN, mobility_over, span_of
from app.simulation.omega.extremes import Effort, ObjectiveValues, Omega, Places, largest
from app.simulation.omega.search_memory import Memory
from app.simulation.system import System
from app.storage.constants_store import KEPT, ConstantsStore
from controllers.bounds import InertiaRange
from controllers.estimate_rates import LocalRates
from environments.catalogue import CATALOGUE
from environments.step_resolution import Mobility, mobilities
from tests.support.arms import lipschitz_of
from tests.support.cases import scenario_of

pytestmark = pytest.mark.slow  # long searches

HARDER = 1.0 + (MARGIN - 1.0) / 2  # half of the margin is all that another search may use up
Value = Callable[[np.ndarray, float], float]


@pytest.fixture(autouse=True, scope="module")
def constants_searched_once() -> None:
    """Not here (tests/conftest.py): it is the search that is tried."""


class Walk:
    """A search of another kind: random steps that are taken where they lead up, longer while they often do."""

    def __init__(self, omega: Omega, value: Value, seed: int) -> None:
        self._omega, self._value = omega, value
        self._random = np.random.default_rng(seed)

    def _within(self, q: np.ndarray) -> np.ndarray:
        away = np.linalg.norm(self._omega.centres - q, axis=1)
        centre = self._omega.centres[away.argmin()]
        return centre + (q - centre) * min(1.0, (1 - 1e-12) * self._omega.radius / max(away.min(), 1e-300))

    def _drawn(self) -> tuple[np.ndarray, float]:
        centre = self._omega.centres[self._random.integers(len(self._omega.centres))]
        away = self._random.standard_normal(len(centre))
        away *= self._omega.radius * self._random.uniform(0.5, 1.0) / np.linalg.norm(away)
        return self._within(centre + away), self._omega.span * self._random.uniform()

    def highest(self, draws: int, starts: int, steps: int) -> float:
        """Of that many draws the best are starts, each of that many steps."""
        drawn = sorted(
            ((self._value(q, t), q, t) for q, t in (self._drawn() for _ in range(draws))), key=lambda x: -x[0]
        )
        return max(self._climbed(*start, steps) for start in drawn[:: max(1, draws // 10)][:starts])

    def _climbed(self, best: float, q: np.ndarray, t: float, steps: int) -> float:
        length = 0.3
        for _ in range(steps):
            there = self._within(q + length * self._omega.radius * self._random.standard_normal(len(q)) / len(q) ** 0.5)
            then = min(max(t + length * self._omega.span * self._random.standard_normal(), 0.0), self._omega.span)
            if (value := self._value(there, then)) > best:
                best, q, t = value, there, then
                length *= 1.5
            else:
                length *= 0.9
        return best


ON_PLANES = tuple(f"{robot} on a plane" for robot in CATALOGUE)
MOVING = ("ur5 on a moving sphere", "ur5 on a typed wave", "panda on a moving sphere", "planar3r on a typed wave")
WIDE, WIDE_GROOVE = "ur5-hybrid, wide", "ur5-groove-moving, wide"
# what Omega and its constants depend on is that of another one
ALIKE = ("planar2r-semicircle-discontinuous", "ur5-corner-coupled", "ur5-heavy", "ur5-motion-discontinuous")
SHAPES = [name for name in shipped() if name not in ALIKE]


@cache
def system_of(name: str) -> System:
    """A shipped scenario, also with a wide Omega; ur5-hybrid with another arm; an arm on what moves."""
    hybrid = shipped()["ur5-hybrid"]
    robot, _, surface = name.partition(" on a ")
    if name in MOVING:
        return assemble(scenario_of(robot, "hybrid", "elastic", surface))
    if name in ON_PLANES:
        return assemble(on_robot(hybrid, robot))
    scenario = shipped()[name.removesuffix(", wide")]
    radius = {WIDE: 0.4, WIDE_GROOVE: 0.3}.get(name, scenario.simulation.domain_radius)
    return assemble(edited(scenario, "simulation.domain_radius", radius))


def inertia_extremes(system: System) -> tuple[Value, Value]:
    """1/lambda_min(H_low), lambda_max(H_high); 0 outside of Omega."""
    limit = system.scenario.simulation.sigma_min

    def inertia(q: np.ndarray, t: float) -> InertiaRange | None:
        seen = system.observer.record_at(q, np.zeros_like(q), t).data
        if np.linalg.svd(seen["task"]["J_q"][0], compute_uv=False)[-1] < limit:
            return None
        return InertiaRange.over(system.controller.uncertainty, seen["estimate"], seen["task"])

    def lightness(q: np.ndarray, t: float) -> float:
        found = inertia(q, t)
        return 0.0 if found is None else float(1.0 / np.linalg.eigvalsh(found.H_low[0])[0])

    def heaviness(q: np.ndarray, t: float) -> float:
        found = inertia(q, t)
        return 0.0 if found is None else float(np.linalg.eigvalsh(found.H_high[0])[-1])

    return lightness, heaviness


@pytest.mark.parametrize("name", [*SHAPES, *ON_PLANES, *MOVING, WIDE, WIDE_GROOVE])
def test_a_harder_search_finds_no_inertia_beyond_property_1(name: str) -> None:
    system = system_of(name)
    constants = system.constants
    lightness, heaviness = inertia_extremes(system)
    lightest = 1.0 / Walk(constants.omega, lightness, 5).highest(300, 4, 200)
    heaviest = Walk(constants.omega, heaviness, 6).highest(300, 4, 200)
    assert constants.k_r_low * HARDER <= lightest <= constants.k_r_low * MARGIN * 1.05
    assert constants.k_r_high / (MARGIN * 1.05) <= heaviest <= constants.k_r_high / HARDER


def flattened(T: np.ndarray) -> float:
    return min(float(np.linalg.norm(np.moveaxis(T, a, 0).reshape(T.shape[a], -1), 2)) for a in range(T.ndim))


def steepness(system: System) -> dict[str, Value]:
    """Each of `Lipschitz` at one posture by differences, in the least of the flattenings' norms."""
    model, n, step = system.robot.model, system.robot.n, 1e-5
    data, units = model.createData(), np.eye(n)
    links = []
    for link in range(1, n + 1):
        links.append(model.copy())
        for other in set(range(1, n + 1)) - {link}:
            links[-1].inertias[other] = pin.Inertia.Zero()

    def coriolis(m: pin.Model, q: np.ndarray) -> np.ndarray:
        return np.array([pin.computeCoriolisMatrix(m, data, q, one) for one in units])

    def change(of: Callable[[np.ndarray], np.ndarray], q: np.ndarray) -> np.ndarray:
        return np.array([of(q + h) - of(q - h) for h in step * units]) / (2 * step)

    return {
        "k_C": lambda q, _: sum(flattened(coriolis(link, q)) for link in links),
        "k_M": lambda q, _: flattened(change(lambda x: pin.crba(model, data, x).copy(), q)),
        "k_Cq": lambda q, _: flattened(change(lambda x: coriolis(model, x), q)),
        "k_G": lambda q, _: flattened(change(lambda x: pin.computeGeneralizedGravity(model, data, x).copy(), q)),
    }


@pytest.mark.parametrize("robot", CATALOGUE)
def test_a_harder_search_finds_nothing_beyond_the_lipschitz_constants(robot: str) -> None:
    system = system_of(f"{robot} on a plane")
    constants = lipschitz_of(system)._asdict() | {"k_C": system.constants.k_C}
    for name, value in steepness(system).items():
        known = constants[name]
        found = Walk(system.constants.omega, value, 7).highest(30, 1, 100)
        assert known / (MARGIN * 1.05) <= found <= known / HARDER, name


@pytest.mark.parametrize("name", [*ON_PLANES, MOVING[0]])
def test_a_harder_search_finds_no_arm_more_mobile(name: str) -> None:
    system = system_of(name)
    model = system.plant.model
    data = model.createData()

    def at(q: np.ndarray, t: float) -> tuple[float, float, float]:
        tool = system.nominal.evaluate(q, np.zeros_like(q))
        normal = system.surface.chart(tool.p, t).G[0]
        M_inv = np.linalg.inv(pin.crba(model, data, q))
        across = np.linalg.svd(normal[None])[2][1:]
        compliance = tool.J_v @ M_inv @ tool.J_v.T
        tangential = np.linalg.norm(across @ compliance @ across.T, 2)
        return float(normal @ compliance @ normal), float(tangential), float(np.linalg.norm(M_inv, 2))

    omega = replace(system.constants.omega, span=span_of(system.surfaces, system.scenario.simulation.duration))
    searched = mobility_over(omega, model, system.surfaces, system.nominal, Memory())
    for k, (known, bound) in enumerate(zip(searched, system.mobility, strict=True)):
        found = Walk(omega, lambda q, t, k=k: at(q, t)[k], 8).highest(100, 2, 120)
        assert known / (MARGIN * 1.05) <= found <= known / HARDER
        assert found <= bound / HARDER  # by the believed arm and the least factor of the true one


def test_a_lighter_arm_is_more_mobile_by_its_factor_at_most_and_needs_no_search_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    system = assemble(edited(shipped()["planar3r-hybrid"], "truth.rotor_scaling", 0.9))
    lighter = edited(system.scenario, "truth.link_scaling", [1.3, 0.6, 0.8])
    monkeypatch.setattr(app.simulation.omega.domain, "largest", None)  # is not called
    bound = np.array(assemble(lighter, system).mobility)
    assert bound == pytest.approx(np.array(system.mobility) * 0.9 / 0.6)


def test_the_mobility_of_an_arm_with_other_centres_and_shapes_is_bounded_by_the_believed_one() -> None:
    """At postures of Omega, with arms anywhere in a wide declared set."""
    system = system_of("ur5 on a plane")
    random, omega = np.random.default_rng(3), system.constants.omega
    model = system.robot.model
    wide = Declared(link_scaling=0.3, rotor_scaling=0.3, link_centre=0.05, link_shape=0.5, payload_mass=1.0)
    for number in range(20):
        drawn = (Departure.inside, Departure.edge)[number % 2](random, model.nv).truth(wide)
        truth = truth_of(msgspec.structs.replace(system.scenario, truth=drawn), system.robot)
        true, q = truth.model(system.robot), omega.places(1).q[number]
        M = np.array([pin.crba(each, each.createData(), q) for each in (true, model)])
        tool = system.nominal.evaluate(q, np.zeros_like(q))
        real, believed = (Mobility(*mobilities(each[None], tool.J_v[None], np.eye(3)[None, :1])[0]) for each in M)
        bound = believed.at_most_for(true, model)
        assert bound is not None
        assert np.all(np.array(real) <= np.array(bound) * (1.0 + 1e-9))


def test_a_harder_search_finds_nothing_beyond_the_rates_of_the_links_errors() -> None:
    system = assemble(edited(system_of("planar3r on a plane").scenario, "declared.link_centre", 0.01))
    steepness = LocalRates(system.robot.model)
    for k, known in enumerate(system.constants.rates):
        found = Walk(system.constants.omega, lambda q, _, k=k: steepness.links(q[None])[0, k], 7).highest(30, 1, 100)
        assert known / (MARGIN * 1.05) <= found <= known / HARDER


def test_postures_beyond_the_limit_are_not_of_omega() -> None:
    """In a wide Omega that reaches beyond the limit of J_q the heaviest arm is there, as the square of 1/sigma_min."""
    wide = edited(on_robot(shipped()["ur5-hybrid"], "planar3r"), "simulation.domain_radius", 1.0)
    heaviest = []
    for limit in (0.05, 0.02):
        system = assemble(edited(wide, "simulation.sigma_min", limit))
        found = Walk(system.constants.omega, inertia_extremes(system)[1], 9).highest(300, 4, 300)
        assert system.constants.k_r_high / (MARGIN * 1.05) <= found <= system.constants.k_r_high / HARDER
        heaviest.append(system.constants.k_r_high)
    assert heaviest[1] == pytest.approx(2.5**2 * heaviest[0], rel=0.1)


SLOPE = np.array([2.0, 1.0])


@pytest.mark.parametrize(("span", "cut"), [(0.0, np.inf), (3.0, np.inf), (0.0, 0.2), (3.0, 0.2)])
def test_search_finds_the_known_extreme_and_nothing_outside(span: float, cut: float) -> None:
    """exp(slope q) (1 + t (span - t)) over two balls that overlap, without the half-plane q_1 > cut."""
    omega = Omega(np.array([[0.0, 0.0], [0.1, 0.05]]), 0.2, span)

    def values(places: Places) -> tuple[ObjectiveValues, ...]:
        q, t = places
        value, room = np.exp(q @ SLOPE) * (1.0 + t * (span - t)), 1.0 - (q[:, 0] / cut) ** 3
        known = q[:, 0] >= -0.15
        return (ObjectiveValues(np.where(known, value, 0.0), np.where(known, room, -1.0)),)

    top = np.array([0.1, 0.05]) + 0.2 * SLOPE / np.linalg.norm(SLOPE)
    if top[0] > cut:
        top = np.array([cut, 0.05 + np.sqrt(0.2**2 - (cut - 0.1) ** 2)])
    highest = float(np.exp(SLOPE @ top)) * (1.0 + span**2 / 4)
    found = largest(omega, values, Effort(60, 3))[0]
    assert highest * (1 - 1e-3) <= found <= highest * (1 + 1e-12)


def test_a_way_between_postures_stays_in_omega_and_a_function_with_its_slope_there_keeps_to_it() -> None:
    """Omega like a horseshoe, with a wall in its opening: the angle along it changes by no more than its rate within
    Omega times the way, but from tip to tip by far more than that times the straight distance."""
    angles, random = np.linspace(0.5, 2.0 * np.pi - 0.5, 200), np.random.default_rng(0)
    omega = Omega(np.array([np.cos(angles), np.sin(angles)]).T, 0.4)
    steepest = 1.0 / (1.0 - omega.radius)  # rad per rad, at the inner edge
    assert omega.way(omega.centres[0], omega.centres[-1]) == pytest.approx(2.0 * np.pi - 1.0, rel=1e-3)
    straight = 0
    for _ in range(500):
        q, q_d = (omega.centres[k] + random.uniform(-0.2, 0.2, 2) for k in random.integers(200, size=2))
        way = omega.way(q, q_d)
        away = float(np.linalg.norm(q - q_d))
        assert way >= away - 1e-12
        straight += way == away
        apart = abs(np.subtract(*(np.arctan2(y, x) % (2.0 * np.pi) for x, y in (q, q_d))))
        assert apart <= steepest * way
    assert 20 < straight < 480


def test_constants_are_reproducible_and_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = shipped()["planar3r-hybrid"]

    def numbers(system: System) -> list[float]:
        c = system.constants
        return [c.k_r_low, c.k_r_high, c.k_C, *(c.lipschitz or ()), *system.mobility]

    first = numbers(assemble(scenario, memory=Memory()))
    assert numbers(assemble(scenario, memory=Memory())) == first
    assert numbers(assemble(scenario, memory=Memory(ConstantsStore(tmp_path)))) == first

    def search(*_: object) -> tuple[float, ...]:
        raise AssertionError("searched again")

    monkeypatch.setattr(app.simulation.omega.domain, "largest", search)
    system = assemble(scenario, memory=Memory(ConstantsStore(tmp_path)))
    assert numbers(system) == first
    indifferent = edited(edited(scenario, "simulation.seed", 5), "simulation.substeps", 4)
    assert numbers(assemble(indifferent, system)) == first
    for path, value in DEPENDED_ON.items():
        with pytest.raises(AssertionError, match="searched again"):
            assemble(edited(scenario, path, value), system)


DEPENDED_ON = {
    "declared.link_scaling": 0.01, "declared.payload_mass": 0.7, "simulation.sigma_min": 0.011,
    "simulation.domain_radius": 0.16, "motion.period": 1.7, "shift.by": [0.003], "surface.normal": [0.1, 0.0, -1.0],
    "robot.rotor_inertia": [0.05, 0.05, 0.03], "task_space.characteristic_length": 0.3,
}  # fmt: skip


def test_constants_store_rejects_damaged_files(tmp_path: Path) -> None:
    constants_store, numbers = ConstantsStore(tmp_path / "constants_store"), (0.353, 2.0)
    constants_store.write("a", numbers)
    constants_store.write("b", (3.0, 4.0))
    paths = {p.read_bytes(): p for p in (tmp_path / "constants_store").iterdir()}
    (content,) = (c for c in paths if b"0.353" in c)
    (other,) = (c for c in paths if c != content)
    path = paths[content]
    assert constants_store.read("a", 2) == numbers
    assert constants_store.read("a", 3) is None
    assert constants_store.read("c", 2) is None
    spoiled = (
        b"", content[:-5], other, content.replace(b"0.353", b"0.354"), content.replace(b"0.353", b"NaN"),
        content.replace(b"0.353", b"-1"), content.replace(b"0.353", b"1e999"), content + b" " * 2000, b"[" * 900,
        b"\xff" * 40, b"null", content.replace(b'"numbers"', b'"number"'),
    )  # fmt: skip
    for wrong in spoiled:
        path.write_bytes(wrong)
        assert constants_store.read("a", 2) is None
    constants_store.write("a", numbers)
    assert constants_store.read("a", 2) == numbers
    path.unlink()
    os.mkfifo(path)
    assert constants_store.read("a", 2) is None


def test_constants_store_ignores_disk_errors(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    constants_store = ConstantsStore(tmp_path / "file" / "folder")
    assert Memory(constants_store).recall("a", 1, lambda: (2.0,)) == (2.0,)
    assert constants_store.read("a", 1) is None
    constants_store = ConstantsStore(tmp_path)
    (tmp_path / constants_store._path("a").name).mkdir()
    constants_store.write("a", (2.0,))
    assert constants_store.read("a", 1) is None


def test_constants_store_evicts_half_when_full(tmp_path: Path) -> None:
    for k in range(KEPT):
        (tmp_path / f"{k}.json").touch()
    constants_store = ConstantsStore(tmp_path)
    constants_store.write("a", (2.0,))
    assert constants_store.read("a", 1) == (2.0,)
    assert len(list(tmp_path.iterdir())) == KEPT // 2 + 1


def test_an_arm_that_is_singular_everywhere_is_refused() -> None:
    with pytest.raises(ScenarioError, match="J_q is singular"):
        assemble(from_plain({"robot": {"name": "ur5"}, "simulation": {"sigma_min": 0.9}}))


@pytest.mark.parametrize("name", ["planar2r-semicircle", "planar3r-hybrid"])
def test_constants_are_those_of_the_scenario_whatever_was_before(name: str) -> None:
    before = shipped()[name]
    heavier = edited(before, "truth.link_scaling", 1.1)
    fresh, after = (assemble(heavier, previous).constants for previous in (None, assemble(before)))
    np.testing.assert_array_equal(after.centres, fresh.centres)
    assert (after.k_r_low, after.k_r_high, after.k_C) == (fresh.k_r_low, fresh.k_r_high, fresh.k_C)
