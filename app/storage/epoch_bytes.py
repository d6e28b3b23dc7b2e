"""Epochs of a recording as bytes: the conditions of its rows, where they were changed during the run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np

from app.scenario.data import from_plain, to_plain
from app.simulation.recording import EPOCHS, Epoch
from controllers.blend import ModelBlend

# names that files of earlier versions have for fields of `Epoch`
FORMER = {
    "reached": "layer_reached",
    "banded": "band_reached",
    "reached_by": "layer_reached_by",
    "banded_by": "band_reached_by",
}


def to_bytes(epochs: Iterable[Epoch]) -> bytes:
    """Bytes (MessagePack, which keeps every bit of a number) of these epochs."""
    return msgspec.msgpack.encode(tuple(epochs), enc_hook=_plain)


def from_bytes(content: bytes, n: int) -> tuple[Epoch, ...]:
    """Epochs of an arm with n joints from bytes that `to_bytes` made. Raises ValueError for any others."""
    try:
        plain = msgspec.msgpack.decode(content)
        epochs = msgspec.convert(_renamed(plain), tuple[Epoch, ...], dec_hook=_whole)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"conditions are not those of a run: {error}") from error
    for epoch in epochs:
        from_plain(to_plain(epoch.scenario))  # refuses what msgspec lets through
        _require_usable(epoch, n)
    times = [epoch.t for epoch in epochs]
    if not 1 <= len(epochs) <= EPOCHS or any(later < before for before, later in pairwise(times)):
        raise ValueError(f"conditions of {len(epochs)} epochs; allowed: 1 to {EPOCHS}, in the order of time")
    return epochs


def _renamed(plain: Any) -> Any:
    """Plain data of epochs with the present names of their fields."""
    if not isinstance(plain, list):
        return plain
    return [{FORMER.get(k, k): v for k, v in each.items()} if isinstance(each, dict) else each for each in plain]


def _require_usable(epoch: Epoch, n: int) -> None:
    blend = epoch.blend
    models = [epoch.model, *([] if blend is None else [blend.start, blend.end])]
    if any(model.n != n for model in models):
        raise ValueError(f"conditions of {epoch.model.n} coordinates; allowed: {n}")
    if not math.isfinite(epoch.t) or (blend is not None and not _lasts(blend)):
        raise ValueError("conditions: an instant that is none; allowed: finite ones, and a blend that lasts")


def _lasts(blend: ModelBlend) -> bool:
    return math.isfinite(blend.begins) and 0.0 < blend.over < math.inf


def _plain(value: object) -> Any:
    """Plain data for a value that MessagePack does not have."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, np.floating):
        return float(value)
    raise NotImplementedError(f"{type(value).__name__} in an epoch")


def _whole(kind: type, value: Any) -> Any:
    """The inverse of `_plain`; msgspec turns a ValueError or TypeError into one of its own."""
    return np.array(value, dtype=float) if kind is np.ndarray else complex(*value)
