"""The table of contents of docs/evidence.md: a new section is a module with a `SECTION`, its prose, and a row here."""

from __future__ import annotations

from app.evidence import blend, paper_cases
from app.evidence.section import Section

SECTIONS: tuple[Section, ...] = (paper_cases.SECTION, blend.SECTION)
