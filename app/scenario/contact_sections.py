"""Sections of a scenario on surfaces: contact, a second and third surface, coupling, and the face of the tool."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import msgspec

from environments.contact_kinds import CONTACTS, FREE, ContactKind, ContactName
from environments.force_profiles.step import ConstantForce
from environments.force_profiles.table import AnyForceProfile
from environments.surfaces.plane import Plane
from environments.surfaces.table import AnyForm
from parameters import Section, Vector3, Widget, decades, field


class ContactSection(Section, frozen=True, forbid_unknown_fields=True):
    """Contact between the tool and the surface."""

    kind: Annotated[
        ContactName,
        field(
            "contact: " + ", ".join(f"{name} {kind.equation or f'({kind.title})'}" for name, kind in CONTACTS.items()),
            "",
        ),
    ] = FREE
    K_e: Annotated[float, field("stiffness of the surface", "N/m", ge=0, le=1e7, title="stiffness of the surface")] = (
        10000.0
    )
    B_e: Annotated[float, field("damping of the surface", "N·s/m", ge=0, le=1e5)] = 0.0
    M_e: Annotated[float, field("mass of the surface", "kg", ge=0, le=1e4)] = 0.0
    unilateral: Annotated[bool, field("the surface only pushes, as real ones do", "", title="Pushes only")] = True
    friction_coulomb: Annotated[
        float, field("friction coefficient", "1", ge=0, le=2, title="friction of the surface")
    ] = 0.0
    friction_viscous: Annotated[float, field("viscous friction along the surface", "N·s/m", ge=0, le=1e4)] = 0.0

    @property
    def nature(self) -> ContactKind:
        """Properties of its kind."""
        return CONTACTS[self.kind]


class FurtherSurface(Section, frozen=True, forbid_unknown_fields=True):
    """A second or third surface, which makes an edge, a groove or a corner with the first; none while its contact is
    `free`."""

    surface: AnyForm = msgspec.field(default_factory=lambda: Plane(normal=(0.0, 1.0, 0.0)))
    contact: ContactSection = msgspec.field(default_factory=ContactSection)
    control: Annotated[
        Literal["force", "path"], field("whether its normal force is controlled, or the tool's distance from it", "")
    ] = "force"
    K_e_hat: Annotated[float, field("estimated stiffness of this surface (33)", "N/m", gt=0, le=1e9)] = 10000.0
    force: AnyForceProfile = msgspec.field(default_factory=ConstantForce)

    @property
    def present(self) -> bool:
        return self.contact.nature.touches


class CouplingSection(Section, frozen=True, forbid_unknown_fields=True):
    """Entries beside the diagonals of the symmetric matrices K_e, B_e, M_e of (28) and K_e_hat of (33) over the
    surfaces: between the first and the second surface, the first and the third, the second and the third. The diagonals
    are the numbers of each surface. Entries of surfaces that are missing, or have no such number, are not read."""

    K_e: Annotated[Vector3, field("stiffness between surfaces 1 and 2, 1 and 3, 2 and 3 (28)", "N/m")] = (0.0, 0.0, 0.0)
    K_e_hat: Annotated[
        Vector3,
        field(
            "estimate of the same stiffness (33)",
            "N/m",
            title="estimated stiffness between surfaces 1 and 2, 1 and 3, 2 and 3 (33)",
        ),
    ] = (0.0, 0.0, 0.0)
    B_e: Annotated[Vector3, field("damping between surfaces 1 and 2, 1 and 3, 2 and 3 (28)", "N·s/m")] = (0.0, 0.0, 0.0)
    M_e: Annotated[Vector3, field("mass between surfaces 1 and 2, 1 and 3, 2 and 3 (28)", "kg")] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SurfaceInWorld:
    """A surface that the tool may meet, as the scenario has it.
    path: beginning of the dotted paths of its fields in the scenario, such as "second.".
    index: its place among first, second and third, from 0.
    pressed: whether its normal force is controlled in a mode on surfaces."""

    path: str
    index: int
    form: Any
    contact: ContactSection
    K_e_hat: float
    force: Any
    pressed: bool


class FaceSection(Section, frozen=True, forbid_unknown_fields=True):
    """Face of the tool: flat, it touches a plane as a whole and is aligned with it by controlled moments, with a
    rotational stiffness beside K_e of (32) and K_e_hat of (33)."""

    flat: Annotated[bool, field("flat face; the tool touches with it, not with a point", "", Widget("flat tool"))] = (
        False
    )
    normal: Annotated[Vector3, field("direction out of the face, in the tool frame", "1", Widget("face normal"))] = (
        0.0,
        0.0,
        1.0,
    )
    K_t: Annotated[
        float, field("rotational stiffness of the face on the surface", "N·m/rad", decades("K_t", 1, 1e3), gt=0, le=1e6)
    ] = 15.0
    K_t_hat: Annotated[
        float, field("estimated rotational stiffness (33)", "N·m/rad", decades("K̂_t", 1, 1e3), gt=0, le=1e6)
    ] = 15.0
    moment: Annotated[
        tuple[float, float],
        field(
            "desired moments about e_1 x n and e_2 x n, with e_1, e_2 the axes of the face",
            "N·m",
            Widget("moments"),
        ),
    ] = (0.0, 0.0)
