"""Target models whose K_f is no multiple of the identity, against every surface that they may touch."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.optimize import minimize

from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.changes import blending_to, in_mode, with_further
from app.simulation.assembly import assemble
from app.simulation.builders.controller_builder import surfaces_met
from app.simulation.closed_loop import ClosedLoop
from controllers.blend import blended
from controllers.surface_stability import (
    SurfaceRange,
    passive,
    passive_throughout,
    require_stable_on,
    unstable_surface,
)
from controllers.target_model import InvalidGain, TargetModel
from tests.support.arms import random_spd

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("rough_constants")]  # long searches

# B_m, K_m and K_f of two coordinates, stable in free motion; on 9000 N/m along (0.927, -0.376) a pole at +6.68 1/s
TWISTED = TargetModel(10.0 * np.eye(2), 60.0 * np.eye(2), np.diag([4000.0, 200.0]), np.array([[3.1, 2.2], [2.2, 1.7]]))

MATRICES = ("M_m", "B_m", "K_m", "K_f")


def touching(model: TargetModel, normal: np.ndarray, K: float, B: float = 0.0, M: float = 0.0) -> float:
    """The rightmost pole (1/s) on a surface, by the roots of the quadratic eigenvalue problem."""
    p, n = len(normal), model.n
    across = np.zeros((n, n))
    across[:p, :p] = np.outer(normal, normal)
    mass, damping, stiffness = (
        matrix + of_surface * model.K_f @ across
        for matrix, of_surface in ((model.M_m, M), (model.B_m, B), (model.K_m, K))
    )
    upper = np.hstack([np.zeros((n, n)), np.eye(n)])
    lower = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    return float(np.linalg.eigvals(np.vstack([upper, lower])).real.max())


def searched(model: TargetModel, surfaces: SurfaceRange, random: np.random.Generator) -> float:
    """The rightmost pole (1/s) by descent from many random normals and surfaces: no common samples, other starts."""
    p, ranges = surfaces.directions, np.array(surfaces[:3])

    def pole(x: np.ndarray) -> float:
        return touching(model, x[:p] / np.linalg.norm(x[:p]), *(ranges * np.clip(x[p:], 0.0, 1.0)))

    starts = [np.r_[random.standard_normal(p), random.random(3) ** random.choice([0.1, 1.0, 4.0])] for _ in range(200)]
    best = [*sorted(starts, key=pole)[-2:], *starts[:2]]
    return max(-float(minimize(lambda x: -pole(x), x, method="Nelder-Mead", options={"maxfev": 300}).fun) for x in best)


def test_the_example_is_unstable_where_it_was_found_to_be() -> None:
    normal = np.array([0.927, -0.376]) / np.hypot(0.927, 0.376)
    assert touching(TWISTED, normal, 9000.0) == pytest.approx(6.68, abs=0.01)
    worst = unstable_surface(TWISTED, TWISTED, SurfaceRange(9000.0, 0.0, 0.0, 0.0, 0, 2, normal=True))
    assert worst is not None
    assert worst.pole.real >= 6.68
    assert touching(TWISTED, worst.normal, worst.K_e) == pytest.approx(worst.pole.real, rel=1e-6)
    assert not passive(TWISTED)


@pytest.mark.parametrize("rest", [(0.0, 0.0), (40.0, 3.0)], ids=["spring", "mass and damper"])
@pytest.mark.parametrize("directions", [2, 3])
def test_another_search_finds_nothing_where_a_model_is_let_pass(directions: int, rest: tuple[float, float]) -> None:
    random, counts = np.random.default_rng(directions), {True: 0, False: 0}
    for _ in range(6):
        n = random.integers(directions, 7)
        M, B, K, K_f = (random_spd(random, n, low, high) for low, high in ((5, 15), (10, 150), (50, 8000), (0.02, 6.0)))
        model = TargetModel(M, B, K, K_f)
        surfaces = SurfaceRange(float(random.uniform(1e3, 3e4)), *rest, 0.0, 0, directions, normal=True)
        found, theirs = unstable_surface(model, model, surfaces), searched(model, surfaces, random)
        counts[found is not None] += 1
        if found is None:
            assert theirs < 0.0
        else:
            assert theirs <= found.pole.real * 1.01
            assert touching(model, found.normal, found.K_e, found.B_e, found.M_e) == pytest.approx(found.pole.real)
    assert min(counts.values()) >= 2, counts


def test_a_passive_model_is_stable_on_every_surface() -> None:
    """K_f^-1 M_m, K_f^-1 B_m, K_f^-1 K_m s.p.d., with a K_f that is no multiple of the identity."""
    random = np.random.default_rng(5)
    for _ in range(4):
        K_f, *divided = (random_spd(random, 4, low, high) for low, high in ((0.1, 5.0), *3 * ((1.0, 1e3),)))
        model = TargetModel(*(K_f @ matrix for matrix in divided), K_f)
        assert passive(model)
        assert searched(model, SurfaceRange(1e5, 50.0, 5.0, 0.0, 0, 3, normal=True), random) < 0.0


def passive_on_a_grid(start: TargetModel, end: TargetModel) -> bool:
    """Whether 201 models of a blend are passive, by their definition; for M_m = 1 the matrices themselves are
    blended."""
    alpha = np.linspace(0.0, 1.0, 201)[:, None, None]
    M_m, B_m, K_m, K_f = ((1.0 - alpha) * getattr(start, X) + alpha * getattr(end, X) for X in MATRICES)
    for divided in (np.linalg.solve(K_f, each) for each in (M_m, B_m, K_m)):
        largest = np.abs(divided).max(axis=(1, 2))
        uneven = np.abs(divided - divided.swapaxes(1, 2)).max(axis=(1, 2))
        if (uneven > 1e-9 * largest).any() or (np.linalg.eigvalsh(divided)[:, 0] <= 0.0).any():
            return False
    return True


def test_a_blend_is_passive_throughout_where_a_fine_grid_of_its_models_is() -> None:
    """Pairs of passive models with K_f^-1 B_m symmetric between them, and others; a few of the first lose their
    definiteness on the way, though not halfway."""
    random, counts = np.random.default_rng(2), Counter[tuple[bool, bool]]()
    for number in range(3000):
        N_0, N_1, S_0 = (random_spd(random, 2, 0.001, 4.0) for _ in range(3))
        S_1 = np.diag(np.exp(random.uniform(np.log(0.001), np.log(4.0), 2)))
        if number % 20:  # N_0 S_0 N_1 + N_1 S_1 N_0 symmetric, by the entry of S_1 that is left
            turned = [N_0 @ S_0 @ N_1 + N_1 @ S @ N_0 for S in (S_1, S_1 + np.eye(2)[::-1])]
            off = [X[0, 1] - X[1, 0] for X in turned]
            S_1[0, 1] = S_1[1, 0] = off[0] / (off[0] - off[1])
        models = [TargetModel(np.eye(2), N @ S, N, N) for N, S in ((N_0, S_0), (N_1, S_1))]
        if not all(passive(model) for model in models):
            continue
        found, halfway = passive_throughout(*models), passive(blended(*models, 0.5))
        counts[halfway, found] += 1
        if halfway > found or number % 20 < 2:
            assert found == passive_on_a_grid(*models), number
    assert {(True, True), (True, False), (False, False)} == set(counts), counts


def twisted(kind: str = "elastic", **contact: float) -> Scenario:
    """A UR5's impedance with `TWISTED` in x and y, above a surface of 9000 N/m."""
    rest = {"M_m": 10.0, "B_m": 60.0, "K_m": 900.0, "K_f": 1.0}
    model = {name: np.diag(6 * [value]) for name, value in rest.items()}
    for name, whole in model.items():
        whole[:2, :2] = getattr(TWISTED, name)
    scenario = edited(shipped()["ur5-impedance"], "contact", {"kind": kind, "K_e": 9000.0, **contact})
    scenario = edited(scenario, "controller.K_e_hat", 9000.0)
    return edited(scenario, "target_model", {name: whole.tolist() for name, whole in model.items()})


@pytest.mark.parametrize("kind", ["elastic", "mass-damper-spring"])
def test_a_model_that_a_surface_makes_unstable_is_refused_as_the_models_fault(kind: str) -> None:
    with pytest.raises(
        ScenarioError, match=r"^target_model: the continuous model \(8\) is unstable by itself"
    ) as refused:
        assemble(twisted(kind))
    assert "allowed: K_f^-1 M_m, K_f^-1 B_m" in str(refused.value)
    assert "sampled" not in str(refused.value)


def test_a_model_whose_other_coordinates_no_point_contact_can_push_is_admitted() -> None:
    """Three pressed planes; the angles' block is not passive."""
    scenario = in_mode(shipped()["ur5-corner"], "hybrid-impedance")
    scenario = with_further(edited(scenario, "second.control", "force"), "third", "elastic")
    scenario = edited(edited(scenario, "third.control", "force"), "motion", "hold")
    K_m, K_f = np.diag([0.0, 0.0, 0.0, 1000.0, 4000.0, 4000.0]), np.eye(6)
    K_f[3:5, 3:5] = [[1.0, 0.5], [0.5, 2.0]]
    given = {"K_m": K_m.tolist(), "K_f": K_f.tolist()}
    assert assemble(edited(scenario, "target_model", given)).controller.model.K_f[3, 4] == 0.5


def test_it_is_refused_when_the_surface_comes_later_or_grows_stiffer() -> None:
    for before, path, value in (
        (twisted("free"), "contact.kind", "elastic"),
        (edited(twisted(K_e=20.0), "controller.K_e_hat", 20.0), "contact.K_e", 9000.0),
    ):
        loop = ClosedLoop.from_scenario(before)
        with pytest.raises(ScenarioError, match="unstable by itself"):
            loop.edit(edited(before, path, value))


def test_every_model_of_a_blend_is_judged_on_the_surfaces_too() -> None:
    """From a K_m that is no multiple of the identity to a K_f that is none: both are passive, those between are not."""
    begin, end = np.diag([8000.0, 200.0]), 2.0 * TWISTED.K_f
    ends = []
    for stiffness, weight in ((begin, 0.02 * np.eye(2)), (200.0 * np.eye(2), end)):
        K_m, K_f = 200.0 * np.eye(6), np.eye(6)
        K_m[:2, :2], K_f[:2, :2] = stiffness, weight
        matrices = {"M_m": 10.0 * np.eye(6), "B_m": 60.0 * np.eye(6), "K_m": K_m, "K_f": K_f}
        assert passive(TargetModel(**matrices))
        ends.append(edited(twisted("free"), "target_model", {name: X.tolist() for name, X in matrices.items()}))
    assemble(blending_to(*ends, at=0.5, over=1.0))
    ends = [edited(end, "contact.kind", "elastic") for end in ends]
    with pytest.raises(ScenarioError, match=r"^blend.to: refused: at α = 0\.\d+ a pole at .* on a surface of"):
        assemble(blending_to(*ends, at=0.5, over=1.0))


@pytest.mark.parametrize("name", ["ur5-hybrid-impedance", "ur5-impedance"])
def test_shipped_models_are_stable_with_viscous_friction(name: str) -> None:
    """They are not once K_f turns forces by 120 degrees."""
    scenario = edited(shipped()[name], "contact.friction_viscous", 2000.0)
    system = assemble(scenario)
    model, surfaces = system.controller.model, surfaces_met(scenario, system.mode, system.layout)
    assert surfaces is not None
    assert surfaces.friction == 2000.0
    assert unstable_surface(model, model, surfaces) is None
    K_f, plane = model.K_f.copy(), slice(surfaces.first, surfaces.first + 2)
    K_f[plane, plane] = [[-0.5, -np.sqrt(0.75)], [np.sqrt(0.75), -0.5]]
    turned = TargetModel(model.M_m, model.B_m, model.K_m, K_f)
    with pytest.raises(InvalidGain, match="unstable by itself, with a pole at"):
        require_stable_on(turned, surfaces)


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-motion"])
def test_models_that_feel_no_friction_need_no_search(name: str) -> None:
    scenario = edited(shipped()[name], "contact.friction_viscous", 40.0)
    system = assemble(scenario)
    assert surfaces_met(scenario, system.mode, system.layout) is None


def test_friction_along_the_surface_is_judged_where_the_tool_yields() -> None:
    """Hybrid impedance of a planar arm: friction acts on psi alone, K_f2 hands it on to the angle."""
    M, B, K, K_f = (np.diag(3 * [value]) for value in (10.0, 600.0, 900.0, 1.0))
    M[1:, 1:] = [[28.22, -8.08], [-8.08, 3.44]]
    B[1:, 1:] = [[17.56, -7.41], [-7.41, 21.92]]
    K[1:, 1:] = [[4299.7, -1820.0], [-1820.0, 825.6]]
    K_f[1:, 1:] = [[2.77, -4.15], [-4.15, 6.29]]
    matrices = {"M_m": M.tolist(), "B_m": B.tolist(), "K_m": K.tolist(), "K_f": K_f.tolist()}
    scenario = edited(in_mode(shipped()["planar3r-hybrid"], "hybrid-impedance"), "target_model", matrices)
    assemble(edited(scenario, "contact.friction_viscous", 0.0))
    with pytest.raises(ScenarioError, match=r"pole at [\d.e+]+ 1/s .* viscous friction = 100 N·s/m"):
        assemble(edited(scenario, "contact.friction_viscous", 100.0))
