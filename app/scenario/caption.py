"""Caption of a figure: its scenario in a few sentences of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from app.scenario.contact_sections import CouplingSection, FurtherSurface
from app.scenario.data import shipped
from app.scenario.field_info import field_info
from app.scenario.number_text import plain, rounded
from app.scenario.schema import Scenario
from app.scenario.units import Units
from controllers.controller import Controller
from controllers.modes import MODES
from environments.catalogue import CATALOGUE

_LAW = ("A", "F_1", "F_2", "K_s")
_ELSEWHERE = ("name", "title", "mode", "robot", "target_model", "controller", "simulation")
_IN_FULL = ("motion", "force")  # of these, and of springs, defaults that are not zero are listed, too


class Title(NamedTuple):
    """Title of what runs. edited: whether it differs from the shipped scenario of its name."""

    text: str
    edited: bool


def title_of(scenario: Scenario, begun_from: Scenario | None) -> Title:
    """Title of a scenario: that of its file, or one made from arm, mode and surfaces where an edit made the file's
    false.
    begun_from: the shipped scenario of this name, None where there is none."""
    own = scenario.title or scenario.name
    if begun_from is None or begun_from == scenario:
        return Title(own, edited=False)
    if _about(scenario) == _about(begun_from):
        return Title(own, edited=True)
    arm = CATALOGUE[scenario.robot.name].title if scenario.robot.urdf is None else "own arm"
    met = [each.form.title for each in scenario.surfaces if each.contact.nature.touches]
    alike = len(met) > 1 and len(set(met)) == 1
    surface = f", {('two', 'three')[len(met) - 2]} {met[0]}s" if alike else "".join(f", {title}" for title in met)
    return Title(f"{arm}: {MODES[scenario.mode].label.lower()}{surface}", edited=True)


def titled(scenario: Scenario) -> str:
    """Title of a scenario with its name, and whether it is an edited one."""
    title = title_of(scenario, shipped().get(scenario.name))
    return f"{title.text} ({scenario.name}{', edited' if title.edited else ''})"


def _about(scenario: Scenario) -> tuple[object, ...]:
    """Parts of a scenario that its title describes. The arm is not among them: with another arm a scenario loses its
    name, and so its title."""
    return scenario.mode, *((each.form.title, each.contact.kind) for each in scenario.surfaces)


def caption(
    scenario: Scenario,
    controller: Controller,
    model: Mapping[str, np.ndarray],
    units: Units,
    t_from: float,
    t_to: float,
    angles: Sequence[int] = (),
) -> str:
    """Sentences on the scenario that was run and the part of the run that is shown.
    controller: the scenario's.
    model: the matrices of (8) in force, each (n, n).
    units: in the scenario's task space.
    t_from, t_to: s.
    angles: coordinates that are angles times l, counted from 0."""
    arm = scenario.robot.urdf or scenario.robot.name
    sentences = [
        f"{titled(scenario)}: {scenario.mode} mode, {arm}, t = {t_from:.4g} to {t_to:.4g} s",
        _model(scenario, model, units, angles),
        _law(scenario, controller, units),
        *(_section(scenario, name, units) for name in _acting(scenario)),
    ]
    return " ".join(f"{sentence}." for sentence in sentences if sentence)


def _acting(scenario: Scenario) -> list[str]:
    """Names of the sections that the caption lists one by one: those that act in this run. No force is asked for where
    none is controlled, and where nothing is touched a surface does not act."""
    left_out: set[str] = {*_ELSEWHERE}
    if not MODES[scenario.mode].force_directions:
        left_out.add("force")
        if not scenario.contact.nature.touches:
            left_out.add("surface")
    return [name for name in scenario.__struct_fields__ if name not in left_out]


def promised(signals: Mapping[str, np.ndarray]) -> str:
    """Sentence on what the theorem promised of ||s|| in recorded rows, and whether the promise was kept. signals:
    s_norm, s_bound, s_band (N,) m/s."""
    over = signals["s_norm"] - signals["s_bound"] - signals["s_band"]
    standing = np.isfinite(over)
    if not standing.any():
        return "Theorem 1 promises nothing here."
    if over[standing].max() > 0.0:
        return "The promise of Theorem 1 is broken here."
    span = (
        "throughout" if standing.all() else f"in {percent(float(standing.mean()))} % of the time, and nothing otherwise"
    )
    return f"Theorem 1's promise for the sampled loop holds {span}."


def stopped_at(reason: str) -> str:
    """Words, in one line, on why a run stopped. reason: begins with the instant; it may be of a file, or have the text
    of an exception of the user's own code."""
    return f"Stopped at {in_one_line(reason)}"


def in_one_line(text: str) -> str:
    """Text with single spaces in place of line breaks and control characters, which files and pages cannot hold."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def percent(share: float) -> str:
    """Share as a percentage with up to four digits, 100 only of the whole."""
    return f"{100 * share if share in (0.0, 1.0) else min(max(100 * share, 0.01), 99.99):.4g}"


def _model(scenario: Scenario, model: Mapping[str, np.ndarray], units: Units, angles: Sequence[int]) -> str:
    """The target model with the units of its task coordinates, which hold angles times a length, and its torsional
    stiffness."""
    matrices = ", ".join(f"{name} = {_matrix(model[name])} {unit}".rstrip() for name, unit in units.of_model.items())
    l = scenario.task_space.characteristic_length
    scaled = f", angles in r times ℓ = {l:g} m" if len(angles) else ""
    if scaled:
        turning = model["K_m"][np.ix_(angles, angles)] * l**2
        scaled += f" (their K_m ℓ² = {_matrix(turning)} N·m/rad)"
    return f"Target model (8): {matrices}{scaled}"


def _law(scenario: Scenario, controller: Controller, units: Units) -> str:
    law, own = scenario.controller, controller.law
    if not own.robust:
        numbers = (f"{p.name} = {plain(controller.parameters[p.name])} {p.unit}".rstrip() for p in own.parameters)
        return ", ".join((f"{own.title[:1].upper()}{own.title[1:]}", *numbers, f"T = {law.period * 1e3:g} ms"))
    gains = ", ".join(f"{name} = {_value(getattr(law, name))}{_unit(f'controller.{name}', units)}" for name in _LAW)
    d = f"d = {plain(law.d)} {units.force}"
    if law.gain == "theorem":
        d = f"d by (17) with ε = {law.epsilon:g} {units.force}, bounds: {law.bounds}"
    layer = f" over {law.layer:g} {units.of_r('m/s')}" if controller.has_layer else ""
    return f"Law (25): {gains}, {d}, {law.switching} switching{layer}, T = {law.period * 1e3:g} ms"


def _section(scenario: Scenario, name: str, units: Units) -> str:
    """Kind of a section and its fields that differ from their defaults; "" when there are none."""
    section: Struct = getattr(scenario, name)
    if isinstance(section, FurtherSurface):
        if not section.present:
            return ""
        shape = (section.surface.title, *_changed(section.surface, f"{name}.surface", units, in_full=False))
        touch = _changed(section.contact, f"{name}.contact", units, in_full=section.contact.nature.springs)
        pressed = (f"{section.control} controlled", *_changed(section.force, f"{name}.force", units, in_full=True))
        return f"{name.capitalize()} surface: {', '.join((*shape, *touch, *pressed))}"
    if isinstance(section, CouplingSection) and len(scenario.surfaces) == 1:
        return ""
    tag = section.__struct_config__.tag
    in_full = name in _IN_FULL or (name == "contact" and scenario.contact.nature.springs)
    parts = ", ".join([*([] if tag is None else [str(tag)]), *_changed(section, name, units, in_full=in_full)])
    if name == "truth":
        return f"True arm: {parts or 'as believed'}"
    return f"{name.replace('_', ' ').capitalize()}: {parts}" if parts else ""


def _changed(section: Struct, path: str, units: Units, *, in_full: bool) -> Iterator[str]:
    usual = type(section)()
    for name in section.__struct_fields__:
        value = getattr(section, name)
        if isinstance(value, Struct):
            yield from _changed(value, f"{path}.{name}", units, in_full=in_full)
        elif isinstance(value, dict):
            yield from (f"{parameter} {plain(number)}" for parameter, number in value.items())
        elif value != getattr(usual, name) or (in_full and isinstance(value, float | tuple) and np.any(value)):
            label = f"{name} = " if "_" in name and name[0].isupper() else f"{name.replace('_', ' ')} "
            yield f"{'' if name == 'kind' else label}{_value(value)}{_unit(f'{path}.{name}', units)}"


def _matrix(matrix: np.ndarray) -> str:
    diagonal = np.diag(matrix)
    if np.count_nonzero(matrix - np.diag(diagonal)):
        return "[" + "; ".join(" ".join(rounded(entry, 4) for entry in row) for row in matrix) + "]"
    if np.all(diagonal == diagonal[0]):
        return f"{rounded(diagonal[0], 4)} I"
    return f"diag({', '.join(rounded(entry, 4) for entry in diagonal)})"


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(_value(v) for v in value)})"
    return plain(value) if isinstance(value, float) else str(value)


def _unit(path: str, units: Units) -> str:
    try:
        unit = field_info(path).unit_in(units)
    except KeyError:
        return ""
    return f" {unit}" if unit else ""
