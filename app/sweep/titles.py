"""Titles of fields that a sweep varies and of their values, with units: the words of the page, for its maps and for
figures."""

from __future__ import annotations

import re
from collections.abc import Callable

from app.export.ticks import plain_number
from app.scenario.field_info import FieldInfo, field_info
from app.scenario.units import Units, unit_in
from app.simulation.controller_builder import laws
from controllers.modes import MODES
from controllers.switching import SWITCHING
from environments.contact_kinds import CONTACTS

# of the fields that are offered first, and of those whose meaning in the schema goes on from the field before
TITLES = {
    "mode": "mode",
    "robot.name": "robot",
    "contact.kind": "contact",
    "controller.switching": "switching function",
    "simulation.leaving_domain": "on a failure (singular J_q, too fast, contact lost)",
    "contact.K_e": "stiffness of the surface",
    "truth.link_scaling": "mass of the true links, factor",
    "truth.payload_mass": "payload",
    "truth.coulomb": "friction in the joints",
    "contact.friction_coulomb": "friction of the surface",
    "controller.K_e_hat": "believed stiffness",
    "controller.layer": "boundary layer",
    "controller.period": "control period",
    "controller.K_s": "reaching gain K_s",
    "controller.F_1": "sliding gain F_1",
    "controller.law": "control law",
    "sensor.noise": "noise of the sensor",
    "sensor.delay": "delay of the sensor",
    "force.value": "desired force",
    "motion.period": "time of one turn",
    "truth.disturbance_frequency": "frequency of the disturbance",
    "truth.push_start": "start of the push",
    "truth.push_duration": "duration of the push",
    "truth.push_every": "time until the push comes again",
    "truth.push_frequency": "frequency of the push",
    "declared.moment_error": "largest error of the sensor's moments (declared)",
    "declared.payload_offset": "largest distance of the payload from the tool point (declared)",
    "declared.least_inertia": "least share c with M ≥ c M̂ (declared)",
    "surface.motion.amplitude": "amplitude of the surface's motion",
    "surface.motion.frequency": "frequency of the surface's motion",
    "surface.tilt.amplitude": "amplitude of the surface's tilt",
    "surface.tilt.frequency": "frequency of the surface's tilt",
    "simulation.domain_radius": "radius of Ω",
    "simulation.seed": "seed of the sensor's noise",
}
# titles on the page of the values of fields that name a row of a table
TITLED: dict[str, Callable[[], dict[str, str]]] = {
    "mode": lambda: {name: mode.label for name, mode in MODES.items()},
    "contact.kind": lambda: {name: kind.title for name, kind in CONTACTS.items()},
    "controller.law": lambda: {name: law.title for name, law in laws().items()},
    "controller.switching": lambda: {name: function.title for name, function in SWITCHING.items()},
}
FURTHER = {"second": "second surface", "third": "third surface"}
# words for the sections whose fields' meanings do not say of what they are
SECTIONS = {
    "truth": "true arm",
    "declared": "declared",
    "motion": "desired motion",
    "rotation": "desired rotation",
    "force": "desired force",
    "surface": "surface",
    "sensor": "sensor",
    "shift": "shift",
    "blend": "blend",
}


def title_of(path: str) -> str:
    """Title of the field at a dotted path, a number at whose end is an entry of a list; the path itself of one that the
    schema does not describe."""
    field, entry = _parted(path)
    first, _, rest = field.partition(".")
    of_first = rest if first in FURTHER else field  # a further surface has the fields of the first one
    info = _info(field)
    if of_first in TITLES:
        title = TITLES[of_first]
    elif info is None or not info.doc:
        return path
    else:
        title = re.split(r"[;:]|, or (?:one|N·m)\b", info.doc)[0].strip()
        about = SECTIONS.get(of_first.partition(".")[0], "")
        title += f" ({about})" if about and about not in title else ""
    title += f" ({FURTHER[first]})" if first in FURTHER else ""
    return f"{title}, entry {', '.join(entry)}" if entry else title


def unit_of(path: str, units: Units) -> str:
    """Unit of the field at a dotted path in a task space with these units, "" for a plain number and for one that the
    schema does not describe."""
    field, _ = _parted(path)
    info = _info(field)
    return "" if info is None or info.unit == "1" else unit_in(units, field, info.unit)


def named(path: str, units: Units) -> str:
    """Title with the unit, as on an axis."""
    unit = unit_of(path, units)
    return f"{title_of(path)} [{unit}]" if unit else title_of(path)


def value_in_words(path: str, value: object) -> str:
    """Value of a field in words: of a row of a table its title on the page, of a number three digits."""
    first, _, rest = path.partition(".")
    titles = TITLED.get(rest if first in FURTHER else path)
    if titles is not None and (title := titles().get(str(value))) is not None:
        return title
    return plain_number(float(f"{value:.3g}"), None) if isinstance(value, float) else str(value)


def _parted(path: str) -> tuple[str, tuple[str, ...]]:
    """Path of a field, and the numbers of an entry behind it."""
    parts = path.split(".")
    numbers = [part for part in parts if part.isdecimal()]
    return ".".join(part for part in parts if not part.isdecimal()), tuple(numbers)


def _info(field: str) -> FieldInfo | None:
    try:
        return field_info(field)
    except KeyError:
        return None
