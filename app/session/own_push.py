"""Own push of a scenario, kept while the push of the button replaces it in the present run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from app.scenario.schema import Scenario

FIELDS = ("push", "push_start", "push_duration")  # of `truth`, that `changes.pushed` changes


@dataclass(frozen=True)
class OwnPush:
    """Own values of the fields that a button has changed, and those that it has given them, by name."""

    fields: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)

    def after_button(self, before: Scenario, after: Scenario) -> OwnPush:
        """Own push once the button has changed one scenario to the other, maybe not for the first time."""
        found = {}
        for name in FIELDS:
            old, new = getattr(before.truth, name), getattr(after.truth, name)
            own, given = self.fields.get(name, (old, old))
            found[name] = (own if old == given else old, new)  # else it has been edited since the button was pressed
        return OwnPush(found)

    def restored_in(self, scenario: Scenario) -> Scenario:
        """The scenario with its own push; a field that has been edited since the button was pressed stays."""
        if not self.fields:
            return scenario
        own = {name: own for name, (own, given) in self.fields.items() if getattr(scenario.truth, name) == given}
        return msgspec.structs.replace(scenario, truth=msgspec.structs.replace(scenario.truth, **own))
