"""Texts of URDFs, sound and hostile."""

from __future__ import annotations

from pathlib import Path

BENT = (Path(__file__).parent / "robots" / "bent3r.urdf").read_text(encoding="utf-8")
UPPER = '<link name="upper">'  # in BENT


def entities(levels: int) -> str:
    """URDF whose name grows tenfold with each of so many levels of entities."""
    grown = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(levels))
    return f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e0 "lol">{grown}]><robot name="&e{levels};"/>'
