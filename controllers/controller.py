"""A controller: a control law with its gains, for one target model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from controllers.bounds import Uncertainty
from controllers.compensator import Compensator
from controllers.control_law import (
    ControlLaw,
    ControlOutput,
    Gains,
    LawInput,
    ModelMatrices,
    Reference,
    add_up,
    clear,
    no_parameters,
)
from controllers.laws import table
from controllers.nominal_model import Estimate
from controllers.reference_estimates import FeedforwardModel
from controllers.sliding import measure
from controllers.switching import SwitchingFunction, number_of
from controllers.target_model import InvalidGain, TargetModel, as_matrix, require_spd
from controllers.task_space import Scratch, TaskSpace
from kernels import kernel
from kernels.records import Record


@kernel
def _evaluate(given, out):
    given, out = given[0], out[0]
    measure(given, out)
    clear(out)
    table.torque(given, out)
    add_up(out)


@dataclass(frozen=True)
class Controller:
    """A control law with its gains, for one target model.

    K_s: (n, n) s.p.d., N s/m.
    d: N, a constant, or None for the theorem's (17); epsilon: N, > 0.
    bounds: those of the modelling errors, see `controllers.bounds`.
    switching, layer: see `controllers.switching`; layer: m/s.
    controlled, surfaces: mask (n,), and number of surfaces among the coordinates, see `controllers.modes`.
    parameters: the law's own, by name.

    Raises InvalidGain.
    """

    law: ControlLaw
    model: TargetModel
    compensator: Compensator
    K_s: np.ndarray
    d: float | None
    epsilon: float
    bounds: Literal["tight", "paper"]
    switching: SwitchingFunction
    layer: float
    uncertainty: Uncertainty
    controlled: np.ndarray
    surfaces: int
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "K_s", as_matrix("controller.K_s", self.K_s, self.model.n))
        require_spd("controller.K_s", self.K_s)
        for name, value, least in (("epsilon", self.epsilon, 0.0), ("d", self.d, 0.0)):
            if value is not None and not (np.isfinite(value) and value > least):
                raise InvalidGain(f"controller.{name}: {value}; allowed: a number > {least}")
        if self.switching.has_layer and not (np.isfinite(self.layer) and self.layer > 0.0):
            raise InvalidGain(f"controller.layer: {self.layer}; allowed: a number > 0, or switching = 'discontinuous'")

    @property
    def has_layer(self) -> bool:
        """Whether the law has a boundary layer: (25) with a switching function that is smooth across s = 0."""
        return self.law.robust and self.switching.has_layer

    @cached_property
    def gains(self) -> Gains:
        """Gains and settings in the form for kernels."""
        c, model = self.compensator, self.model
        return Gains(
            law=table.number_of(self.law),
            model=ModelMatrices(model.M_m, np.linalg.inv(model.M_m), model.B_m, model.K_m, model.K_f),
            A=np.diag(c.A),
            F_1=np.diag(c.F_1),
            F_2=np.diag(c.F_2),
            K_pz=c.K_pz,
            K_vz=c.K_vz,
            K_fz=c.K_fz,
            K_s=self.K_s,
            controlled=np.array(self.controlled, dtype=float),
            K_s_largest=float(np.linalg.eigvalsh(self.K_s)[-1]),
            K_s_smallest=float(np.linalg.eigvalsh(self.K_s)[0]),
            damping_rate=float(np.linalg.norm(np.linalg.solve(model.M_m, model.B_m) + c.A, 2)),
            surfaces=self.surfaces,
            by_theorem=self.d is None,
            d=float(self.d or 0.0),
            epsilon=float(self.epsilon),
            tight=self.bounds == "tight",
            switching=number_of(self.switching),
            layer=float(self.layer) if self.switching.has_layer else np.inf,
            reaching_share=self.switching.reaching_share,
            uncertainty=self.uncertainty,
        )

    def following(self, model: TargetModel) -> Controller:
        """Controller for another target model with as many coordinates; the gains of (13) are computed anew."""
        c = self.compensator
        return replace(self, model=model, compensator=Compensator.design(model, c.A, c.F_1, c.F_2))

    def evaluate(
        self,
        z: np.ndarray,
        reference: Reference,
        task: TaskSpace,
        estimate: Estimate,
        feedforward: FeedforwardModel,
        q: np.ndarray,
        q_dot: np.ndarray,
        F: np.ndarray,
    ) -> ControlOutput:
        """Output of a law of the table at one instant; z (n,) m/s, q (n,) rad, q_dot (n,) rad/s, F (6,) measured
        wrench of the tool on the environment. Raises ValueError for another F.

        feedforward: `FeedforwardModel.at(estimate)` when estimates are taken on-line, otherwise see Remark 3.
        """
        if F.shape != (6,):
            raise ValueError(f"F: of shape {F.shape}; allowed: (6,), force and moment")
        n = self.model.n
        work, out, own = Scratch.zeros(n), Record.zeros(ControlOutput, n), no_parameters.py_func(self.gains)
        given = LawInput(self.gains, own, reference, task, estimate, feedforward, z, q, q_dot, F, work)
        _evaluate(Record(given).data, out.data)
        return out.read()
