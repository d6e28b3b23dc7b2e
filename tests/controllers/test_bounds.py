"""The gain that the law itself asks for, (17), against arms drawn from the declared set, cause by cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin
import pytest

from app.simulation.system import System
from controllers.bounds import (
    CAUSES,
    Equivalent,
    InertiaRange,
    RequiredGain,
    Uncertainty,
    coriolis_rate,
    list_terms,
    required_gain,
)
from controllers.controller import Controller
from controllers.estimate_rates import SYMMETRIC_BASIS, LinkRates, LocalRates
from controllers.nominal_model import ON_LINE, Estimate
from controllers.reference_estimates import FeedforwardModel
from controllers.switching import SWITCHING
from tests.support.arms import CERTAIN, ROBOTS, State, charted, lipschitz_of, random_law, random_reference
from tests.support.declared_plants import CHART, DECLARED, Plant, direction, doubted, draw, draw_state, in_task_space

PLANTS = 100  # per arm: 600 in all
SOURCES = (
    "rho", "rho_rotor", "rho_centre", "rho_shape", "payload_mass", "coulomb", "viscous", "disturbance", "force_error",
    "moment_error",
)  # fmt: skip
Bounds = Literal["tight", "paper"]


def law_for(system: System, u: Uncertainty, bounds: Bounds) -> Controller:
    """A law that takes d from the theorem."""
    n = system.robot.n
    law = random_law(np.random.default_rng(1), n, SWITCHING["saturation"], np.zeros(n))
    mass = sum(link.mass for link in list(system.robot.model.inertias)[1:])
    known = u._replace(k_C=system.constants.k_C, rates=rates_of(system.robot.name), mass=mass)
    return replace(law, d=None, bounds=bounds, uncertainty=known)


@cache
def rates_of(robot: str) -> LinkRates:
    """Largest rates that a few postures around the working one have, with half as much again for the others."""
    system, random = charted(robot, CHART), np.random.default_rng(8)
    steepness = LocalRates(system.robot.model)
    seen = steepness.links(np.array([draw_state(system, random).q for _ in range(30)]))
    return LinkRates(*(1.5 * np.max(seen, axis=0)).tolist())


class Need(NamedTuple):
    """What the true arm needs, N, and what the law has, d - epsilon N.
    terms: the same of each term of the tight gain, by its name; {} for other gains."""

    needed: float
    offered: float
    terms: dict[str, tuple[float, float]]


def compare(
    system: System,
    laws: Sequence[Controller],
    plant: Plant,
    state: State,
    seed: int,
    override: FeedforwardModel | None = None,
) -> list[Need]:
    """For each law ||J_q^-T (Delta M q_eq_ddot + Delta C q_eq_dot + Delta G + f - J^T error)|| against d - epsilon.

    The terms of (25) say what the law believes; the true arm is asked for the same q_eq_dot and q_eq_ddot. The tight
    gain has a share for each of these terms.
    """
    random, n = np.random.default_rng(seed), system.robot.n
    q, q_dot, t = state
    estimate, task = system.observe(q, q_dot, t)
    reference = random_reference(task.r, random)
    reference = reference._replace(r_d_dot=10 ** random.uniform(-2.0, 0.3) * reference.r_d_dot)
    feedforward = FeedforwardModel.at(estimate) if override is None else override
    z, F = random.uniform(0.0, 1.0) * random.standard_normal(n), random.standard_normal(6)
    model = plant.truth.model(system.robot)
    data = model.createData()
    M, C = pin.crba(model, data, q).copy(), pin.computeCoriolisMatrix(model, data, q, q_dot).copy()
    gravity = pin.computeGeneralizedGravity(model, data, q)
    J = np.vstack([estimate.J_v, estimate.J_w])
    unknown = plant.truth.torque(q_dot, t) - J.T @ plant.wrench_error
    needs = []
    for law in laws:
        out = law.evaluate(z, reference, task, estimate, feedforward, q, q_dot, F)
        q_eq_dot = task.J_q_inv @ (task.r_dot - out.s - task.v_t)
        q_eq_ddot = np.linalg.solve(feedforward.M_hat, out.terms.inertia)
        given = out.terms.inertia + out.terms.coriolis + out.terms.gravity + out.terms.force
        assert out.d == pytest.approx(sum(out.needed))
        needed = np.linalg.norm(task.J_q_inv.T @ (M @ q_eq_ddot + C @ q_eq_dot + gravity + J.T @ F + unknown - given))
        terms = {
            "inertia": (M - feedforward.M_hat) @ q_eq_ddot,
            "coriolis": (C - feedforward.C_hat) @ q_eq_dot,
            "gravity": gravity - feedforward.G_hat,
            "disturbance": unknown,
        }
        by_term = {
            name: (float(np.linalg.norm(task.J_q_inv.T @ torque)), float(getattr(out.needed, name)))
            for name, torque in terms.items()
            if law.bounds == "tight"
        }
        needs.append(Need(float(needed), out.d - law.epsilon, by_term))
    return needs


def require_each_term(need: Need) -> None:
    """Each term stays under its own share, so that no share hides that another one is too small."""
    for name, (needed, offered) in need.terms.items():
        assert needed <= offered * (1.0 + 1e-9) + 1e-9, name


@pytest.mark.parametrize("robot", ROBOTS)
def test_gain_covers_every_arm_of_the_declared_set(robot: str) -> None:
    """Links, payload, friction, disturbance and sensor error at once; the tight gain is the smaller one."""
    system, random = doubted(robot), np.random.default_rng(2)
    laws = [law_for(system, DECLARED, bounds) for bounds in ("tight", "paper")]
    for seed in range(PLANTS):
        plant, state = draw(DECLARED, random, system.robot.n), draw_state(system, random)
        tight, paper = compare(system, laws, plant, state, seed)
        assert tight.needed <= tight.offered <= paper.offered
        assert tight.needed == pytest.approx(paper.needed)
        require_each_term(tight)


@pytest.mark.parametrize("bounds", ["tight", "paper"])
@pytest.mark.parametrize("robot", ["ur5", "panda", "planar3r"])
def test_gain_covers_estimates_taken_along_the_reference(robot: str, bounds: Bounds) -> None:
    """Remark 3: M_hat, C_hat, G_hat from a posture and rate nearby."""
    system, random = doubted(robot), np.random.default_rng(3)
    law, n, lipschitz = law_for(system, DECLARED, bounds), system.robot.n, lipschitz_of(system)
    for seed in range(60):
        plant, state = draw(DECLARED, random, n), draw_state(system, random)
        q_d = state.q + 10 ** random.uniform(-4.0, -1.0) * direction(random, n)
        q_d_dot = state.q_dot + 10 ** random.uniform(-3.0, 0.0) * direction(random, n)
        there: Estimate = system.nominal.evaluate(q_d, q_d_dot)
        deviation = lipschitz.deviation(float(np.linalg.norm(state.q - q_d)), state.q_dot, q_d_dot)
        override = FeedforwardModel(there.M_hat, there.C_hat, there.G_hat, deviation)
        (need,) = compare(system, [law], plant, state, seed, override)
        assert need.needed <= need.offered
        require_each_term(need)


def test_the_terms_of_17_are_listed_in_the_order_of_their_causes() -> None:
    terms = np.full(len(CAUSES), np.nan)
    list_terms.py_func(RequiredGain(**{cause: float(i) for i, cause in enumerate(CAUSES)}), terms)
    assert terms.tolist() == list(range(len(RequiredGain._fields)))


@pytest.mark.parametrize("cause", SOURCES)
@pytest.mark.parametrize("robot", ["ur5", "planar3r"])
def test_each_cause_has_its_own_share(robot: str, cause: str) -> None:
    """One cause at a time: arms inside stay below the gain and come near to it, arms outside go over it."""
    system, random = doubted(robot), np.random.default_rng(4)
    n = system.robot.n
    u = CERTAIN._replace(**{cause: getattr(DECLARED, cause)})
    laws = [law_for(system, u._replace(**{cause: getattr(DECLARED, cause) / part}), "tight") for part in (1, 4)]
    exhausted, over = [], 0
    for seed in range(60):
        plant, state = draw(u, random, n), draw_state(system, random)
        need, much = compare(system, laws, plant, state, seed)  # the second law believes in a quarter of it
        assert need.needed <= need.offered * (1.0 + 1e-9)
        require_each_term(need)
        exhausted.append(need.needed / need.offered)
        over += much.needed > much.offered
    assert max(exhausted) > (0.25 if cause == "rho_centre" else 0.4)  # what independent shifts do adds up
    assert over > 0


@pytest.mark.parametrize("robot", ROBOTS)
def test_paper_bounds_are_those_of_7(robot: str) -> None:
    """Term by term with exact 2-norms: at most four norms in a product, each up to 3 % too large."""
    system, random = charted(robot, CHART), np.random.default_rng(7)
    u = CERTAIN._replace(rho=0.2, rho_rotor=0.4, viscous=0.3, disturbance=2.0)
    law = law_for(system, u, "paper")
    q, q_dot, t = draw_state(system, random)
    estimate, task = system.observe(q, q_dot, t)
    reference, z = random_reference(task.r, random), random.standard_normal(system.robot.n)
    out = law.evaluate(z, reference, task, estimate, FeedforwardModel.at(estimate), q, q_dot, np.zeros(6))

    r_eq_dot = task.r_dot - out.s
    r_eq_ddot = reference.r_d_ddot - law.compensator.F_1 @ out.e_r_dot - law.compensator.F_2 @ out.z_dot
    J_inv, speed = np.linalg.norm(task.J_q_inv, 2), np.linalg.norm(q_dot)
    E = u.rho * estimate.M_links + u.rho_rotor * (estimate.M_hat - estimate.M_links)
    delta_M, delta_C_q = np.linalg.norm(E, 2), u.rho * law.uncertainty.k_C * speed
    delta_G_q = u.rho * np.linalg.norm(estimate.G_links, axis=1).sum()
    delta_H = delta_M * J_inv**2
    turning = np.linalg.norm(task.J_q_inv @ task.J_q_dot @ task.J_q_inv, 2)
    delta_C = delta_C_q * J_inv**2 + delta_M * J_inv * turning
    exact = (
        delta_H * np.linalg.norm(r_eq_ddot),
        delta_C * np.linalg.norm(r_eq_dot),
        J_inv * delta_G_q,
        delta_H * np.linalg.norm(task.v_t_dot) + delta_C * np.linalg.norm(task.v_t),
        J_inv * (u.viscous * speed + u.disturbance),
        law.epsilon,
    )
    ratio = np.array(out.needed) / np.array(exact)
    assert ratio.min() >= 1.0 - 1e-12
    assert ratio.max() <= system.robot.n ** (4 / 64)


@pytest.mark.parametrize("robot", ["ur5", "planar3r"])
def test_errors_of_the_links_change_the_christoffel_matrix_as_pinocchio_says(robot: str) -> None:
    """What a shift of a centre of mass does, to first order, and a change of an inertia, link by link."""
    system, random = charted(robot, CHART), np.random.default_rng(9)
    model, q, n = system.robot.model, draw_state(system, random).q, system.robot.n
    steepness, data = LocalRates(model), model.createData()
    by_centre, by_inertia = steepness.by_centre(q), steepness.by_inertia(q)
    pin.forwardKinematics(model, data, q)
    for link in range(n):
        R, own = data.oMi[link + 1].rotation, model.inertias[link + 1]

        def C(shift: np.ndarray, more: np.ndarray, joint: int, link: int = link, own: pin.Inertia = own) -> np.ndarray:
            arm = model.copy()
            arm.inertias[link + 1] = pin.Inertia(own.mass, own.lever + shift, own.inertia + more)
            return pin.computeCoriolisMatrix(arm, arm.createData(), q, np.eye(n)[joint]).copy()

        none, round_ = np.zeros((3, 3)), 2.0 * np.eye(3)
        for joint in range(n):
            for axis in range(3):
                along = R.T[:, axis]
                moved = 0.5 * (C(along, none, joint) - C(-along, none, joint))
                np.testing.assert_allclose(by_centre[link, joint, :, :, axis], moved, atol=1e-12)
            for number, K in enumerate(SYMMETRIC_BASIS):
                grown = C(np.zeros(3), round_ + R.T @ K @ R, joint) - C(np.zeros(3), round_, joint)
                np.testing.assert_allclose(by_inertia[link, joint, :, :, number], grown, atol=1e-12)


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_christoffel_matrix_of_centres_that_are_far_away_is_within_its_bound(robot: str) -> None:
    """Centres moved by metres, as no arm's are: there what grows with the square of the shift counts, which nothing
    shows where they move by centimetres."""
    system, random = charted(robot, CHART), np.random.default_rng(10)
    model, steepness, shares, by_square = system.robot.model, LocalRates(system.robot.model), [], 0
    for _ in range(30):
        q, q_dot, _ = draw_state(system, random)
        u = CERTAIN._replace(rho_centre=10.0, rates=LinkRates(*steepness.links(q[None])[0]))
        arm = draw(u, random, system.robot.n).truth.model(system.robot)
        C, C_hat = (pin.computeCoriolisMatrix(each, each.createData(), q, q_dot) for each in (arm, model))
        rate = np.linalg.norm(C - C_hat, 2) / np.linalg.norm(q_dot)
        shares.append(rate / coriolis_rate.py_func(u))
        by_square += rate > u.rho_centre * u.rates.k_centre
    assert max(shares) <= 1.0
    assert by_square > 0


@pytest.mark.parametrize("bounds", ["tight", "paper"])
@pytest.mark.parametrize("robot", ["ur5", "planar2r"])
def test_stated_bounds_take_the_place_of_those_of_the_links(robot: str, bounds: Bounds) -> None:
    """Any M, C, G and f within the stated bounds need no more than the law has, whatever is declared of the links; as
    much further out, they do."""
    stated = {"delta_M": "0.02 + 0.1*away", "delta_C": "0.3*speed", "delta_G": 2.0, "delta_f": "1 + 0.5*speed"}
    system, random = doubted(robot, **stated), np.random.default_rng(10)
    n, law = system.robot.n, law_for(system, DECLARED._replace(force_error=0.0, moment_error=0.0), bounds)
    over = 0
    for _ in range(40):
        q, q_dot, t = draw_state(system, random)
        estimate, task = system.observe(q, q_dot, t)
        speed, away = np.linalg.norm(q_dot), np.linalg.norm(q - system.q_0)
        assert estimate.stated == pytest.approx((0.02 + 0.1 * away, 0.3 * speed, 2.0, 1.0 + 0.5 * speed, 0.3, 0.5))
        q_eq_dot, q_eq_ddot = random.standard_normal(n), 3.0 * random.standard_normal(n)
        r_eq_dot, bent = task.J_q @ q_eq_dot + task.v_t, task.J_q_dot @ q_eq_dot
        equivalent = Equivalent(r_eq_dot, task.J_q @ q_eq_ddot + bent + task.v_t_dot, q_eq_dot, q_eq_ddot)
        offered = sum(required_gain(bounds, law.uncertainty, ON_LINE, estimate, task, q_dot, equivalent))
        size = np.array(estimate.stated)
        # each error alone where it counts most: along the rows of J_q^-T that are longest
        longest = np.linalg.svd(task.J_q_inv.T)[2][0]
        errors = [size[0] * np.outer(longest, q_eq_ddot) / np.linalg.norm(q_eq_ddot) @ q_eq_ddot]
        errors += [size[1] * longest * np.linalg.norm(q_eq_dot), size[2] * longest, size[3] * longest]
        needed = float(np.linalg.norm(task.J_q_inv.T @ np.sum(errors, axis=0)))
        assert needed <= offered * (1.0 + 1e-9)
        over += 1.5 * needed > offered
        H = InertiaRange.at(law.uncertainty, estimate, task)
        E = size[0] * np.eye(n)
        np.testing.assert_allclose(H.H_high, in_task_space(task, estimate.M_hat + E), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(H.H_low, in_task_space(task, estimate.M_hat), rtol=1e-9, atol=1e-9)
    assert over > 20 or bounds == "paper"
