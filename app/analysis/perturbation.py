"""Quantities of recorded instants that only the simulation can know: the perturbation that (17) bounds, V, and the
force at which the target model would settle. Computed on request, from the recording and the true arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from app.analysis.steady_force import settled, steady_forces
from app.scenario.schema import Scenario
from app.simulation.builders.controller_builder import compensation, law_of
from app.simulation.builders.environment_builder import truth_of
from app.simulation.period.observation import Observer
from app.simulation.recording import Epoch
from app.simulation.system import System
from controllers.bounds import CAUSES
from controllers.nominal_model import NominalModel
from environments.truth import Truth

Signals = Mapping[str, np.ndarray]

STEADY = ("steady_force", "steady_force_2", "steady_force_3")
KEPT = 2000  # instants of which the results are kept
SAME = 1e-9  # s: instants that are no farther apart are one


class Instant(NamedTuple):
    """Quantities at one instant.
    perturbation: norm of what d has to outweigh in (23), N; inertia, coriolis, gravity, disturbance: norms of its
    parts.
    V: J.
    yielding_force: the normal force at which an impedance would settle if r_d stood still, N, nan in other modes."""

    perturbation: float
    inertia: float
    coriolis: float
    gravity: float
    disturbance: float
    V: float
    yielding_force: float


NOWHERE = Instant(*7 * (np.nan,))
PARTS = tuple(cause for cause in CAUSES if cause in Instant._fields)  # of the perturbation; (17) bounds each


class PerturbationAnalysis:
    """Analysis of one run's perturbation, with a true arm of its own, outside the loop's thread."""

    def __init__(self, system: System) -> None:
        robot = system.robot
        self.system = system
        self._observer = Observer(
            NominalModel(robot.model, robot.tool_joint, robot.tool_placement), system.charted.shapes, system.layout
        )
        self._arm: tuple[Scenario, Truth, pin.Model, pin.Data] | None = None
        self._kept: dict[float, Instant] = {}

    def recorded(self, rows: Signals, epochs: Sequence[Epoch], openings: np.ndarray) -> DerivedSignals:
        """Signals of rows of the run's recording; the costly ones are computed in the rows `openings` only, and
        kept."""
        if len(self._kept) > KEPT:
            self._kept.clear()
        return DerivedSignals(self, rows, epochs, openings, self._kept)

    def foreseen(self, rows: Signals, epochs: Sequence[Epoch], openings: np.ndarray) -> DerivedSignals:
        """Signals of rows of a preview of the same run."""
        return DerivedSignals(self, rows, epochs, openings, {})

    def at(self, row: Signals, epoch: Epoch) -> Instant:
        """Quantities at one recorded row. The parts of the perturbation are the differences between the law's terms
        (25) and those of the true arm: J_q^-T ((M_hat - M) q_eq_ddot), the same of C q_eq_dot and of G, and the rest of
        (4) with the part of the torque that the drives do not give."""
        scenario, t, q, q_dot = epoch.scenario, float(row["t"]), row["q"], row["q_dot"]
        truth, model, data = self._true_arm(scenario)
        try:
            estimate, task = self._observer.at(q, q_dot, t)
        except ValueError:  # J_q exactly singular
            return NOWHERE
        behind = task.J_q_inv @ row["s"] if law_of(scenario).robust else np.zeros_like(q)
        q_eq_dot = q_dot - behind
        C = pin.computeCoriolisMatrix(model, data, q, q_dot).copy()
        M = pin.crba(model, data, q)
        withheld = row["tau_applied"] - row["tau"]
        really = estimate.J_v.T @ (row["F_true"] - row["F_push"])
        really += estimate.J_w.T @ (row["moment_true"] - row["moment_push"])
        missed = np.array(
            [
                row["tau_inertia"] - M @ row["q_eq_ddot"],
                row["tau_coriolis"] - C @ q_eq_dot,
                row["tau_gravity"] - pin.computeGeneralizedGravity(model, data, q),
                row["tau_force"] - really - truth.torque(q_dot, t) + withheld,
            ]
        )
        parts = missed @ task.J_q_inv
        inertia, coriolis, gravity, disturbance = (float(np.linalg.norm(part)) for part in parts)
        together = float(np.linalg.norm(parts.sum(axis=0)))
        V = 0.5 * float(behind @ M @ behind)
        return Instant(together, inertia, coriolis, gravity, disturbance, V, self._yielding_force(row, epoch))

    def _true_arm(self, scenario: Scenario) -> tuple[Truth, pin.Model, pin.Data]:
        if self._arm is None or self._arm[0].truth != scenario.truth:
            truth = truth_of(scenario, self.system.robot)
            model = truth.model(self.system.robot)
            self._arm = (scenario, truth, model, model.createData())
        return self._arm[1:]

    def _yielding_force(self, row: Signals, epoch: Epoch) -> float:
        """Normal force (N) of an impedance (27) against a surface K_e, see `Instant`: with r_d at depth phi_d, along
        the normal n there, phi = phi_d - n^T K_m^-1 (K_f n K_e phi + M_m A s), (14); see `settled` for a law that reads
        no force."""
        system, K_e = self.system, epoch.scenario.contact.K_e
        alone = len(system.surfaces) == 1
        if system.m or system.layout.joint or not system.plant.nature.springs or not alone:
            return np.nan
        t, positions = float(row["t"]), system.layout.positions
        g = np.zeros(3)
        g[:positions] = row["r_d"][:positions]
        chart = system.surface.chart(system.charted.point(g, t), t)
        normal = np.zeros(system.layout.n)
        normal[:positions] = (system.charted.frame @ chart.G[0])[:positions]
        try:
            model, A = epoch.model_at(t), compensation(epoch.scenario, system.layout.n)
            model, rest = settled(law_of(epoch.scenario), model, A, row["s"])
            yielding = float(normal @ np.linalg.solve(model.K_m, model.K_f @ normal))
            deeper = float(normal @ np.linalg.solve(model.K_m, rest))
        except np.linalg.LinAlgError:
            return np.nan
        depth = chart.g[0] + deeper
        depth = max(depth, 0.0) if epoch.scenario.contact.unilateral else depth
        return K_e * float(depth) / (1.0 + yielding * K_e)


class DerivedSignals(Mapping[str, np.ndarray]):
    """Signals by name: the recorded ones, and further ones, (N,) each, that are computed when they are first read:
    those of `Instant`;
    steady_force, steady_force_2, steady_force_3 N: where the target model would settle on each surface if the reference
    stood still;
    V_bound, V_limit J: (24), and (24) with what sampling and boundary layer add;
    reaching: 1 until s is reached;
    promised, measured: 1 in the row of t_r, by (18) and as measured."""

    def __init__(
        self,
        analysis: PerturbationAnalysis,
        rows: Signals,
        epochs: Sequence[Epoch],
        openings: np.ndarray,
        kept: dict[float, Instant],
    ) -> None:
        self._analysis, self._rows, self._epochs = analysis, rows, epochs
        self._openings, self._kept = openings, kept
        self._found: dict[str, np.ndarray] = {}
        self._makers = {
            **dict.fromkeys(Instant._fields, self._examine),
            **dict.fromkeys(STEADY, self._steady_forces),
            "V_bound": lambda: self._V(self._rows["s_bound"]),
            "V_limit": lambda: np.square(np.sqrt(self["V_bound"]) + np.sqrt(self._rows["V_band"])),
            "reaching": self._mark,
            "promised": self._mark,
            "measured": self._mark,
        }

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._makers:
            return self._rows[name]
        if name not in self._found:
            made = self._makers[name]()
            self._found.update(made if isinstance(made, dict) else {name: made})
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._rows
        yield from self._makers

    def __len__(self) -> int:
        return len(self._rows) + len(self._makers)

    def _numbers(self) -> np.ndarray:
        """Number (N,) of each row's epoch."""
        begins = np.array([epoch.t for epoch in self._epochs])
        return np.maximum(np.searchsorted(begins - SAME, self._rows["t"], side="right") - 1, 0)

    def _examine(self) -> dict[str, np.ndarray]:
        t, numbers = self._rows["t"], self._numbers()
        found = np.full((len(t), len(Instant._fields)), np.nan)
        for i in self._openings:
            key = float(t[i])
            if key not in self._kept:
                row = {name: self._rows[name][i] for name in _LOOKED_AT}
                self._kept[key] = self._analysis.at(row, self._epochs[int(numbers[i])])
            found[i] = self._kept[key]
        return dict(zip(Instant._fields, found.T, strict=True))

    def _steady_forces(self) -> dict[str, np.ndarray]:
        """Steady force on each surface, nan on one whose force is not controlled."""
        unknown, rows = np.full(len(self._rows["t"]), np.nan), self._steady_force().T
        return {name: rows[i] if i < len(rows) else unknown for i, name in enumerate(STEADY)}

    def _steady_force(self) -> np.ndarray:
        """Steady normal forces (N, k) N on the k surfaces that are pressed: by (37) for the present desired forces
        where a mode controls them, else that of an impedance, (27) to (29), with the part that the present s leaves,
        (14)."""
        system, m, s = self._analysis.system, self._analysis.system.m, self._rows["s"]
        if not m:
            return self["yielding_force"][:, None]
        r_d, F_cd = self._rows["r_d"], self._rows["F_cd"]
        numbers, found = self._numbers(), np.empty_like(F_cd[:, :m])
        for number in np.unique(numbers):
            epoch, rows = self._epochs[number], np.flatnonzero(numbers == number)
            for piece in [rows] if epoch.blend is None else rows[:, None]:
                model, A = epoch.model_at(float(self._rows["t"][piece[0]])), compensation(epoch.scenario, s.shape[1])
                model, rest = settled(law_of(epoch.scenario), model, A, s[piece])
                if system.plant.nature.rigid:
                    found[piece] = F_cd[piece, :m] + np.linalg.solve(model.K_f[:m, :m], rest[:, :m].T).T
                else:
                    found[piece] = steady_forces(epoch.scenario, model, r_d[piece], F_cd[piece], rest)
        return found[:, : system.pressed]

    def _V(self, s_norm: np.ndarray) -> np.ndarray:
        k_r_low = np.array([epoch.certificate.k_r_low for epoch in self._epochs])[self._numbers()]
        return 0.5 * k_r_low * s_norm**2

    def _mark(self) -> dict[str, np.ndarray]:
        t = self._rows["t"]
        found = {name: np.zeros(len(t)) for name in ("reaching", "promised", "measured")}
        for epoch, following in zip(self._epochs, (*self._epochs[1:], None), strict=True):
            end = np.inf if following is None else following.t
            if end < t[0] or not law_of(epoch.scenario).robust:
                continue
            reached = np.inf if epoch.layer_reached is None else epoch.layer_reached
            found["reaching"][(t >= epoch.t) & (t < min(reached, end) - SAME)] = 1.0
            if epoch.certificate.t_r < epoch.scenario.controller.period:
                continue  # nothing to reach: promised within one period
            promised = np.inf if epoch.band_reached_by is None else epoch.t + epoch.certificate.t_r
            for name, instant in (("promised", promised), ("measured", reached)):
                row = int(np.searchsorted(t, instant - SAME))
                if t[0] < instant < end and row < len(t):
                    found[name][row] = 1.0
        return found


# signals of a row that `PerturbationAnalysis.at` reads
_LOOKED_AT = (
    "t", "q", "q_dot", "s", "q_eq_ddot", "tau_inertia", "tau_coriolis", "tau_gravity", "tau_force", "tau",
    "tau_applied", "F_true", "F_push", "moment_true", "moment_push", "r_d",
)  # fmt: skip
