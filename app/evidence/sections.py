"""Sections of docs/evidence.md in their order: a new one is a module with a `SECTION`, its prose, and a row here."""

from __future__ import annotations

from app.evidence import (
    baselines,
    blend,
    closed_forms,
    convergence,
    families,
    paper_cases,
    practice,
    simulators,
    theorem,
)
from app.evidence.section import EvidenceSection

SECTIONS: tuple[EvidenceSection, ...] = (
    paper_cases.SECTION,
    theorem.SECTION,
    closed_forms.SECTION,
    convergence.SECTION,
    simulators.SECTION,
    baselines.SECTION,
    practice.SECTION,
    blend.SECTION,
    families.SECTION,
)
