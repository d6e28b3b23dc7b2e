"""Table of the premises of the theorem: each value against its limit, and when it first failed."""

from __future__ import annotations

from html import escape

from app.dashboard.widgets.chips import chip, verdict_now, verdict_of_run
from app.scenario.caption import percent
from app.scenario.number_text import rounded, without_rounding
from app.session.snapshot import Snapshot
from app.simulation.omega.domain import MARGIN
from app.simulation.promise.verdict import Finding
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise


def premises_html(snapshot: Snapshot) -> str:
    """Table of the premises that apply now, with the verdict above it, as HTML."""
    standing = snapshot.standing
    (now, look), (whole, look_of_run), run = verdict_now(standing), verdict_of_run(standing), standing.run
    head = f"<div>{chip(f'now: {now}', look)} {escape(standing.now.because)}</div>"
    if whole != now:
        head += (
            f"<div>{chip(f'this run: {whole}', look_of_run)} {escape(run.because)}; "
            f"all premises held in {percent(run.share)} % of its periods</div>"
        )
    rows = "".join(_row(f) for f in standing.findings)
    titles = "".join(f"<td>{title}</td>" for title in ("premise", "value", "limit", "least margin", "now", "failed"))
    return f'{head}<table class="vs-facts vs-premises"><tr>{titles}</tr>{rows}</table>{_constants(snapshot)}'


def _constants(snapshot: Snapshot) -> str:
    """Note on the constants of (19) and (20) and how they were found, as HTML."""
    constants = snapshot.system.constants
    unit = snapshot.system.units.of_model["M_m"]
    low, high = rounded(constants.k_r_low), rounded(constants.k_r_high)
    return (
        f'<div class="vs-note">(19): k_r′ = {low} {unit}, k_r″ = {high} {unit} for '
        f"every declared arm over Ω, found by search, with a margin of {100 * (MARGIN - 1):.0f} %.</div>"
    )


def _row(finding: Finding) -> str:
    words = STATEMENTS[Premise[finding.premise.upper()]]
    value = "—" if finding.value is None else _small(finding.value)
    margin = "—" if finding.margin is None else _small(finding.margin)
    limit = f"{finding.sign} {_small(finding.limit)} {finding.unit}"
    if words.counts:
        value, limit, margin = "yes" if finding.holds else "no", "—", "—"
    now = chip("holds", "vs-good") if finding.holds else chip("fails", "vs-bad")
    failed = "—" if finding.failed is None else f"{finding.failed:.3f} s"
    return (
        f'<tr title="{escape(words.why)}"><td>{escape(finding.title)}</td><td>{value}</td><td>{escape(limit)}</td>'
        f"<td>{margin}</td><td>{now}</td><td>{failed}</td></tr>"
    )


def _small(value: float) -> str:
    return rounded(without_rounding(value))
