"""Modes: the five applications of section IV (and Remark 6), and what each fixes of task space, target model and
F_c."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from controllers.surface_stability import SurfaceRange, require_stable_on
from controllers.target_model import InvalidGain, TargetModel, require_spd, require_spsd


@dataclass(frozen=True)
class Mode:
    """Mode, one row of section IV.

    label: its short name; title: its full name; summary: a sentence about it.
    equation: the paper's number of its target model.
    on_surface: r begins with phi (31), otherwise it is Cartesian (or r = q).
    feedback: part of the interaction force that is F_c.
    rigid: whether its surface is rigid, (39), so that the multiplier is controlled.
    stiffness: N/m, default of K_m.
    surfaces, forces: number of surfaces in the world, and of those, the first ones, whose normal force is controlled
    where r begins with phi.
    tilts: number of tilts of a flat tool, after phi, whose moments are controlled there.
    """

    name: str
    label: str
    title: str
    equation: str
    summary: str
    on_surface: bool
    feedback: Literal["none", "normal", "all"]
    rigid: bool = False
    stiffness: float = 4000.0
    surfaces: int = 1
    forces: int = 1
    tilts: int = 0

    @property
    def in_joints(self) -> bool:
        """Whether r may be q: where no force has to be measured in space."""
        return self.feedback == "none"

    @property
    def force_directions(self) -> int:
        """Number m of force-controlled directions: pressed surfaces and aligned tilts."""
        return self.forces + self.tilts if self.on_surface else 0

    @property
    def pressed(self) -> int:
        """Number of surfaces whose normal force is controlled."""
        return self.forces if self.on_surface else 0

    @property
    def normals(self) -> int:
        """Number of coordinates that are the phi of a surface."""
        return self.surfaces if self.on_surface else 0

    def among(self, surfaces: int, forces: int, tilts: int = 0) -> Mode:
        """This mode in a world of `surfaces` surfaces: controls the force on the first `forces` of them, and the
        moments of `tilts` tilts of a flat tool."""
        return replace(self, surfaces=surfaces, forces=forces, tilts=tilts)

    def admits(self, *, touches: bool, rigid: bool) -> bool:
        """Whether the mode is made for a kind of contact: with a surface or without, one that yields or a rigid one."""
        return rigid == self.rigid and (touches or not self.on_surface)

    def controlled(self, n: int) -> np.ndarray:
        """Mask (n,), 1 for each component of the interaction force that enters F_c."""
        mask = np.zeros(n)
        if self.feedback == "all":
            mask[:] = 1.0
        elif self.feedback == "normal":
            mask[: self.force_directions] = 1.0
        return mask

    def fixed(self, n: int) -> dict[str, np.ndarray]:
        """Masks (n, n), bool, of the entries of each matrix that the mode fixes, all at zero."""
        m, inside = self.force_directions, np.ones((n, n), dtype=bool)
        coupling = inside.copy()
        coupling[:m, :m] = coupling[m:, m:] = False
        stiffness = coupling.copy()
        stiffness[:m, :m] |= self.rigid
        force = inside.copy() if self.feedback == "none" else coupling.copy()
        if self.feedback == "normal":
            force[m:, :] = True
            force[:, m:] = True
        return {"M_m": coupling, "B_m": coupling.copy(), "K_m": stiffness, "K_f": force}

    def environment(self, n: int, K_e_hat: np.ndarray | float) -> np.ndarray:
        """Stiffness (n, n) N/m that the model meets: K_e_hat (33), a number, (m,) or (m, m), or a rigid surface (41),
        infinite on the diagonal, along the controlled normals, 0 elsewhere. A matrix (k, k) has the followed surfaces
        of the same body, too."""
        m, stiffness = self.force_directions, np.zeros((n, n))
        if self.rigid:
            K_e_hat = np.inf
        if np.ndim(K_e_hat) == 2:
            k = np.shape(K_e_hat)[0]
            stiffness[:k, :k] = K_e_hat
        else:
            stiffness[np.arange(m), np.arange(m)] = K_e_hat
        return stiffness

    def poles(self, model: TargetModel, K_e_hat: np.ndarray | float) -> np.ndarray:
        """Poles (1/s) of (8) in contact, two for each coordinate that can move: on a rigid surface r_f = 0 (42)."""
        stiffness = self.environment(model.n, K_e_hat)
        free = np.ix_(*2 * (np.isfinite(np.diag(stiffness)),))
        moving = TargetModel(*(X[free] for X in (model.M_m, model.B_m, model.K_m, model.K_f)))
        return moving.poles(stiffness[free])

    def check(self, model: TargetModel, K_e_hat: np.ndarray | float, surfaces: SurfaceRange | None = None) -> None:
        """Raise InvalidGain, naming matrix and reason, unless the mode admits the model.

        K_e_hat: estimated stiffness (N/m), with which the model must be stable, see `environment`.
        surfaces: all surfaces that the tool may touch, on which the model must be stable, None for none.
        """
        m, n = self.force_directions, model.n
        for name, entries in self.fixed(n).items():
            matrix = getattr(model, name)
            wrong = np.argwhere(entries & (matrix != 0.0))
            if len(wrong):
                i, j = wrong[0]
                raise InvalidGain(
                    f"target_model.{name}: an entry that {self.name} mode fixes at 0 {self.equation} is "
                    f"{matrix[i, j]:.4g}, in row {i + 1}, column {j + 1}"
                )
        for part, rows in (("1", slice(0, m)), ("2", slice(m, n))) if m else (("", slice(0, n)),):
            require_spd(f"target_model.M_m{part}", model.M_m[rows, rows])
            require_spd(f"target_model.B_m{part}", model.B_m[rows, rows])
            if part == "1":
                require_spsd("target_model.K_m1", model.K_m[rows, rows])
            else:
                require_spd(f"target_model.K_m{part}", model.K_m[rows, rows])
            if self.controlled(n)[rows].all():
                require_spd(f"target_model.K_f{part}", model.K_f[rows, rows])
        unstable = float(np.real(self.poles(model, K_e_hat)).max())
        if unstable >= -1e-9:
            raise InvalidGain(
                f"target_model: unstable in contact, a pole at {unstable:.4g} 1/s; allowed: all poles left of 0, (8)"
            )
        if surfaces is not None and self.feedback == "all":
            require_stable_on(model, surfaces)


MODES: dict[str, Mode] = {
    mode.name: mode
    for mode in (
        Mode(
            "motion",
            "Motion",
            "Robust motion control",
            "(26)",
            "The tool follows its path whatever the modelling errors; forces are compensated, not controlled.",
            on_surface=False,
            feedback="none",
        ),
        Mode(
            "impedance",
            "Impedance",
            "Impedance control",
            "(27)",
            "The tool yields to forces like the mass, damper and spring that you choose.",
            on_surface=False,
            feedback="all",
            stiffness=1000.0,
        ),
        Mode(
            "hybrid",
            "Hybrid position / force",
            "Hybrid position/force control",
            "(34)",
            "The normal force follows the desired one while the tool follows its path along the surface.",
            on_surface=True,
            feedback="normal",
        ),
        Mode(
            "hybrid-impedance",
            "Hybrid impedance / force",
            "Hybrid impedance/force control",
            "(38)",
            "The normal force is controlled, and the tool yields along the surface.",
            on_surface=True,
            feedback="all",
        ),
        Mode(
            "constrained",
            "Constrained motion",
            "Constrained motion control",
            "(41)",
            "The surface is rigid: the contact force follows the desired one while the tool moves on the surface.",
            on_surface=True,
            feedback="normal",
            rigid=True,
        ),
    )
}
IN_JOINTS = tuple(name for name, mode in MODES.items() if mode.in_joints)  # modes in which r may be q
if TYPE_CHECKING:
    ModeName = str
else:
    ModeName = Literal[tuple(MODES)]
