"""Changes of a run's scenario on its way, as a recording's file tells them beside the first scenario."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from app.scenario.data import differences
from app.scenario.schema import Scenario, after_blend
from app.simulation.recording import Epoch

BLENDED = "the planned blend has ended, its model is the target model from here on"


@dataclass(frozen=True)
class ScenarioChange:
    """Change of the scenario: the rows from t (s) on are those of `after`, the ones before of `before`."""

    t: float
    before: Scenario
    after: Scenario

    def lines(self) -> list[str]:
        """Lines such as "from t = 0.2 s: contact.K_e = 20000.0": one for each field, with values as in TOML, and the
        instant to the last bit, as the rows have it."""
        if self.before.blend.planned and self.after == after_blend(self.before):
            return [f"from t = {self.t!r} s: {BLENDED}"]
        changed = differences(self.before, self.after)
        return [f"from t = {self.t!r} s: {path} {_becomes(value)}" for path, (_, value) in changed.items()]


def changes_of(epochs: Iterable[Epoch]) -> tuple[ScenarioChange, ...]:
    """Changes between these epochs, in their order. A paused run is changed several times at one instant: the last
    scenario is that of the rows from there on. A new name or title is no change."""
    held = {epoch.t: epoch.scenario for epoch in epochs}
    pairs = pairwise(held.items())
    return tuple(ScenarioChange(t, before, after) for (_, before), (t, after) in pairs if differences(before, after))


def _becomes(value: Any) -> str:
    # JSON of numbers, texts and lists of these is TOML, in one line
    return "is not given" if value is None else f"= {json.dumps(value, ensure_ascii=False)}"
