"""The sections practice and families of the evidence, on few of their cases: what they tell can be made."""

from __future__ import annotations

import pytest

from app.evidence import families, practice
from app.sweep.question import SweepQuestion
from tests.support.svg import texts_of

pytestmark = pytest.mark.slow  # long or many simulations


def test_every_name_in_the_prose_on_practice_has_its_number_table_or_figure() -> None:
    section = practice.SECTION
    results = [job.function(*job.arguments) for job in section.jobs(10**6)]
    assert section.text(section.conclude(results), "evidence").startswith(section.heading)


def test_families_of_arms_tell_what_is_inside_the_declared_set_and_what_outside() -> None:
    asked = SweepQuestion(families.map_of("vsmrc"))
    ends = (0, asked.count // 2, asked.count - 1)  # links of 0.7, 1.05 and 1.4 times the mass
    tables = [families.map_rows(law, ends) for law in families.LAWS]
    for table in tables:
        assert [row["declared"] for row in table.rows] == [0.0, 1.0, 0.0]
    bands = [families.arms(law, (0, 1)) for law in families.LAWS]
    found = families.conclude([*tables, *bands])
    numbers, errors = found.numbers, [row["force_error"] for row in tables[0].rows]
    assert numbers["robust_inside"] == f"{errors[1]:.2g}"
    assert numbers["robust_outside"] == f"{max(errors[0], errors[2]):.2g}"
    assert (numbers["arms"], numbers["holds"], numbers["broken"]) == ("2", "2", "0")
    assert 0.0 < float(numbers["ratio"]) <= 1.0
    titles = texts_of(found.figures["map"])
    assert any("link" in title or "mass" in title for title in titles), titles
    assert families.SECTION.text(found, "evidence").startswith(families.SECTION.heading)
