"""The sections practice and families of the evidence, on few of their cases: what they tell can be made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.analysis.metrics import Account
from app.evidence import baselines, families, practice
from app.sweep.plan import SweepPlan
from tests.support.svg import texts_of

pytestmark = pytest.mark.slow  # long or many simulations


def test_every_name_in_the_prose_on_practice_has_its_number_table_or_figure() -> None:
    section = practice.SECTION
    results = [job.function(*job.arguments) for job in section.jobs(10**6)]
    assert section.text(section.conclude(results), "evidence").startswith(section.heading)


def test_families_of_arms_tell_what_is_inside_the_declared_set_and_what_outside() -> None:
    asked = SweepPlan(families.map_of("vsmrc"))
    ends = (0, asked.count // 2, asked.count - 1)  # links of 0.7, 1.05 and 1.4 times the mass
    tables = [families.map_rows(law, ends) for law in families.LAWS]
    for table in tables:
        assert [row["declared"] for row in table.rows] == [0.0, 1.0, 0.0]
    edge, beyond = (
        next(k for k in range(asked.count) if asked.row(k).values == pytest.approx(at))
        for at in ({"contact.K_e": 1e4, "truth.link_scaling": scaling} for scaling in (1.15, 1.3))
    )
    bands = [families.arms(law, (0, 1)) for law in families.LAWS]
    told_of = families.map_rows("vsmrc", (edge, beyond))
    found = families.conclude([*tables, told_of, *bands])
    committed = " ".join((Path(__file__).parents[2] / "docs" / "evidence.md").read_text(encoding="utf-8").split())
    told = f"this law is {found.numbers['edge']} mN at the edge of the set (1.15) and {found.numbers['beyond']} mN at"
    assert told in committed
    numbers, errors = found.numbers, [row["force_error"] for row in tables[0].rows]
    assert numbers["robust_inside"] == f"{max(errors[1], told_of.rows[0]['force_error']):.2g}"
    assert numbers["robust_outside"] == f"{max(errors[0], errors[2]):.2g}"
    assert (numbers["arms"], numbers["holds"], numbers["broken"]) == ("2", "2", "0")
    assert 0.0 < float(numbers["ratio"]) <= 1.0
    titles = texts_of(found.figures["map"])
    assert any("link" in title or "mass" in title for title in titles), titles
    assert families.SECTION.text(found, "evidence").startswith(families.SECTION.heading)


def test_a_run_beyond_its_bound_counts_also_where_nothing_is_promised_in_some_periods() -> None:
    known = np.array([-1e-3, np.nan, 2e-3, np.nan])
    over_bound, promised = baselines._beyond(known)
    assert (over_bound, promised) == (2e-3, 0.5)
    assert baselines._beyond(np.full(4, np.nan)) == (None, 0.0)
    account = Account(1e-3, 2e-3, None, None, 1.0, 2.0, 0.1, 1.0, 10.0, 20.0, None)
    kept = baselines.Outcome(account, -1e-3, 1.0, None)
    gone = replace(kept, over_bound=over_bound, promised=promised)
    lots = [[kept, gone], [gone, replace(kept, over_bound=None, promised=0.0)], *[[kept, kept]] * 4]
    others = [kept] * 6 + [[kept]] * (6 * len(baselines.NOISES))
    text = baselines.SECTION.text(baselines.conclude([*lots, *others]), "evidence")
    words = " ".join(text.split())
    assert "Of the 4 runs of the robust laws, 3 have a promise: with the layer in 75 % of the" in words
    assert (
        "discontinuous law in 25 %, since a premise fails in the others. There ‖s‖ was over (20) with its band" in words
    )
    assert "where s(0) = 0, in 2 of the runs" in words
