"""JSON text that somebody else may have written."""

from __future__ import annotations

from typing import TypeVar

import msgspec

Value = TypeVar("Value")


def decode_json(content: bytes, kind: type[Value]) -> Value:
    """Value of this type that a JSON text holds. Raises ValueError with the reason for any other content."""
    try:
        return msgspec.json.decode(content, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(str(error)) from error
