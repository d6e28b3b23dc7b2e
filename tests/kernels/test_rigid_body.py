"""Rigid bodies without Pinocchio against Pinocchio, for every robot of the catalogue and an arm with sliding joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from controllers.nominal_model import NominalModel, Terms
from environments import robots
from environments.catalogue import CATALOGUE
from environments.truth import Truth
from kernels import kernel
from kernels.records import Record
from kernels.rigid_body import (
    Chain,
    Motion,
    bias_torque,
    estimated_terms,
    forward_kinematics,
    jacobian_rate,
    link_inertias,
    mass_matrix,
)

STATES = 20
# of the largest number of each array: a sum of n products of rounded numbers
PRECISION = 2e-14


@kernel
def estimate_motion(chain, q, q_dot, motion):
    """Compute the terms of the law at q, q_dot (n,): J, J_dot, momenta, C and placements."""
    forward_kinematics(chain[0], q, motion[0])
    jacobian_rate(q_dot, motion[0])
    link_inertias(chain[0], motion[0])
    estimated_terms(chain[0], motion[0])


@kernel
def drive_motion(chain, q, q_dot, motion):
    """Compute the terms of the plant at q, q_dot (n,): J, J_dot, M and bias."""
    forward_kinematics(chain[0], q, motion[0])
    jacobian_rate(q_dot, motion[0])
    link_inertias(chain[0], motion[0])
    bias_torque(chain[0], q_dot, motion[0])
    mass_matrix(chain[0], motion[0])


def true_model(robot: robots.Robot) -> pin.Model:
    """Arm with scaled links and a payload, which the controller does not know."""
    scaling = np.linspace(0.8, 1.3, robot.n)
    return Truth(scaling, 1.7, np.array([0.02, -0.05, 0.1]), 0.0, 0.0, 0.0, 0.0).model(robot)


def sliding_model() -> pin.Model:
    """Arm of turning and sliding joints about oblique axes, with rotors."""
    model, random = pin.Model(), np.random.default_rng(5)
    kinds = (pin.JointModelPX, pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned, pin.JointModelRY)
    for i, kind in enumerate(kinds):
        axis = random.normal(size=3)
        oblique = "Unaligned" in kind.__name__
        joint = kind(axis / np.linalg.norm(axis)) if oblique else kind()
        model.addJoint(i, joint, pin.SE3.Random(), f"joint {i}")
        model.appendBodyToJoint(i + 1, pin.Inertia.Random(), pin.SE3.Identity())
    model.armature = random.uniform(0.1, 1.0, len(kinds))
    return model


def models() -> dict[str, pin.Model]:
    """The arms by name: as the controller knows them, and as they are."""
    arms = {"sliding": sliding_model()}
    for name in CATALOGUE:
        robot = robots.load(name)
        arms |= {name: robot.model, f"{name} with a payload": true_model(robot)}
    return arms


MODELS = models()


def require_same(name: str, found: np.ndarray, expected: np.ndarray) -> None:
    """Fail unless the arrays are the same to machine precision."""
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=PRECISION * max(1.0, abs(expected).max()), err_msg=name)


@pytest.mark.parametrize("name", MODELS)
def test_terms_are_those_of_pinocchio(name: str) -> None:
    model = MODELS[name]
    nominal, data = NominalModel(model, model.nv, pin.SE3.Identity()), model.createData()
    chain, motion = Record(Chain.of(model)), Record(Motion.zeros(model.nv))
    random = np.random.default_rng(1)
    for _ in range(STATES):
        q, q_dot = random.uniform(-3.0, 3.0, model.nv), random.normal(size=model.nv)
        terms, found = nominal.update(q, q_dot), motion.views
        estimate_motion(chain.data, q, q_dot, motion.data)
        for field in Terms._fields:
            require_same(field, getattr(found, field).T, getattr(terms, field))

        drive_motion(chain.data, q, q_dot, motion.data)
        M = np.triu(pin.crba(model, data, q))
        require_same("M", found.M, M + np.triu(M, 1).T)
        require_same("bias", found.bias, pin.nonLinearEffects(model, data, q, q_dot))
        require_same("J_dot", found.J_dot.T, terms.J_dot)
