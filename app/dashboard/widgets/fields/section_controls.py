"""Controls of a section that has several kinds: a menu of the kinds, and the fields of all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from app.dashboard.widgets.fields.controls import Control, Desk, Dropdown, NumberField, labelled
from app.dashboard.widgets.fields.field_binding import BindingWhere, FieldBinding, SliderScale
from app.dashboard.widgets.fields.own_parameters import own_number
from app.dashboard.widgets.fields.text_field import TextField
from app.scenario.data import OWN, kind_of
from app.scenario.field_info import field_info, paths_below
from app.scenario.schema import Scenario
from app.session.snapshot import Snapshot
from environments.surfaces.own import OwnSurface
from environments.trajectories.own import OwnTrajectory
from parameters import Parameter

_Own = Mapping[str, OwnSurface] | Mapping[str, OwnTrajectory]
_Applies = Callable[[Scenario], bool]


def kind_choice(
    desk: Desk,
    section: str,
    label: str,
    kinds: Sequence[Any],
    own: _Own,
    applies: _Applies | None = None,
    hint: str = "",
) -> Dropdown:
    """Menu of a section's kinds.
    kinds: allowed ones, each with its `title`.
    own: those of the user's own files, by kind.
    applies: see `BindingWhere`.
    hint: what is chosen, in words."""
    options = {kind.title: str(kind.__struct_config__.tag) for kind in kinds}
    options = {title: kind for title, kind in options.items() if kind != OWN}
    options |= {each.title: f"{OWN}:{name}" for name, each in own.items()}
    return Dropdown(desk, section, label, options, applies, hint)


def field_controls(
    desk: Desk, section: str, kinds: Sequence[Any], own: _Own, applies: _Applies | None = None
) -> list[Control]:
    """Controls of the fields of all kinds; a control is shown where the section has its field and `applies` is True."""
    controls: list[Control] = []
    for name, each in own.items():
        controls += [_own_parameter(desk, section, f"{OWN}:{name}", p) for p in each.parameters]
    for path in paths_below(section, kinds):
        if field_info(path).widget is not None:
            controls.append(field_control(desk, path, applies))
    return controls


def field_control(desk: Desk, path: str, applies: _Applies | None = None) -> Control:
    """Control of the field at a dotted path, with the label, slider or menu that the schema's `Widget` for it says.
    applies: see `BindingWhere`."""
    info = field_info(path)
    if (shown := info.widget) is None:
        raise ValueError(f"{path} has no widget in the schema")
    binding = FieldBinding(path) if applies is None else BindingWhere(path, applies)
    if shown.options:
        return Dropdown(desk, path, shown.label, dict(shown.options), applies)
    if info.text:
        return TextField(desk, binding, shown.label)
    scale = None
    if shown.low is not None and shown.high is not None:
        scale = SliderScale(shown.low, shown.high, shown.logarithmic, shown.zero)
    return NumberField(desk, binding, labelled(shown.label, info.unit), scale)


def _own_parameter(desk: Desk, section: str, kind: str, p: Parameter) -> NumberField:
    def running(snapshot: Snapshot) -> float | None:
        now = FieldBinding(section).read(snapshot)
        return now.parameters.get(p.name, p.value) if now is not None and kind_of(now) == kind else None

    place = f"{section}.parameters"
    return own_number(desk, f"{place}.{p.name}", p, running, field_info(place).of)
