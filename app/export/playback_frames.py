"""Playback frames: a recording thinned to one row per frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.scenario.schema import Scenario
from app.simulation.recording import Recording

FRAMES_PER_SECOND = 30
DRAWN = ("t", "q", "q_dot", "r_d", "F_cd", "tool", "F_true")


@dataclass(frozen=True)
class PlaybackFrames:
    """Playback frames, oldest first. signals: those of `DRAWN` by name, (N,) or (N, width), SI units, a recorded row
    for each frame."""

    scenario: Scenario
    signals: dict[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.signals["t"])


def playback_frames(
    scenario: Scenario, recording: Recording, t_from: float = -math.inf, t_to: float = math.inf
) -> PlaybackFrames:
    """Playback frames of a recording over t_from <= t <= t_to (s): the first row of each thirtieth of a second."""
    rows, frame = [np.empty((0, recording.width))], -math.inf
    for piece in recording.pieces(t_from, t_to):
        frames = np.floor(piece[:, 0] * FRAMES_PER_SECOND + 1e-6)  # a row at the end of a frame belongs to the next one
        rows.append(piece[np.diff(frames, prepend=frame) > 0])
        frame = frames[-1]
    kept = np.concatenate(rows)
    columns = {name: kept[:, recording.columns[name]] for name in DRAWN}
    return PlaybackFrames(scenario, {name: values[:, 0] if name == "t" else values for name, values in columns.items()})
