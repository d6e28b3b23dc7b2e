"""Lines of what has not happened yet: the preview, and the band of true arms."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.analysis.thinning import BucketGrid
from app.dashboard.plots.chart_frames import Frame
from app.dashboard.plots.charts import ChartLine
from app.dashboard.plots.dock import Plots, Shown
from app.dashboard.plots.line_values import column
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.view_options import Viewing
from app.scenario.data import shipped
from app.session.arm_band import ArmBand
from app.session.preview import PreviewRun
from app.session.preview_messages import Preview, PreviewRequest
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from tests.support.plotted import ran


@pytest.fixture(scope="module")
def hybrid() -> ClosedLoop:
    return ran(shipped()["ur5-hybrid"], 1.0)


def test_a_preview_goes_on_where_every_line_knows_what_lies_ahead(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    ahead = {name: values[::100] for name, values in rows.items()}
    frame = Frame(1.0, 1.0, BucketGrid.over(0.0, 1.0, 100), rows, (), np.arange(10) * 0.1 + 0.1, ahead)
    line = ChartLine("s", (0, 0, 0), column("s_norm"))
    x, drawn = frame.courses([line])
    assert x[-1] == pytest.approx(1.0)
    np.testing.assert_array_equal(drawn[-10:], ahead["s_norm"])
    x, _ = frame.courses([replace(line, foreseen=False)])
    assert x[-1] == 0.0


def test_a_preview_is_drawn_also_before_the_run_has_begun(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    ahead, nothing = ({name: values[part] for name, values in rows.items()} for part in (slice(0, 900, 100), slice(0)))
    frame = Frame(0.0, 1.0, BucketGrid.over(-1.0, 0.0, 100), nothing, (), np.arange(9) * 0.1 + 0.1, ahead)
    x, drawn = frame.courses([ChartLine("s", (0, 0, 0), column("s_norm"))])
    np.testing.assert_allclose(x[x > 0.0], np.arange(9) * 0.1 + 0.1)
    np.testing.assert_array_equal(drawn[x > 0.0], ahead["s_norm"])
    assert np.isnan(drawn[x <= 0.0]).all()


def test_a_band_is_drawn_ahead_only_as_quantiles_of_the_arms_that_still_run(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    begun, now = 0.9, 1.0
    ahead, later = np.arange(1, 11) * 0.1, np.arange(0, 13) * 0.1  # of the preview; of the band, from `begun` on
    arms = np.outer(np.arange(5.0), np.ones(13)) + later  # arm i has i + t
    arms[4, 5:] = np.nan  # and the last one stops
    signals = {"t": np.tile(begun + later, 5), "s_norm": arms.ravel()}
    band = ArmBand(begun, 1.3, later, 5, signals, 1, "it left", whole=True)
    foreseen = {"t": now + ahead, "s_norm": 2.0 + ahead}
    frame = Frame(now, 1.0, BucketGrid.over(0.0, 1.0, 100), rows, (), ahead, foreseen, band, begun - now + later)
    line = ChartLine("s", (0, 0, 0), column("s_norm"), quantiles=(0.0, 0.5, 1.0))
    x, shown = frame.courses([line])
    least, median, largest = frame.spread(x, [shown], [line])
    past = x <= 0.0
    for quantile in (least, median, largest):
        np.testing.assert_array_equal(quantile[past], shown[past])
    np.testing.assert_allclose(least[~past], 0.1 + ahead)
    np.testing.assert_allclose((median[~past][:3], largest[~past][:3]), (2.1 + ahead[:3], 4.1 + ahead[:3]))
    np.testing.assert_allclose((median[~past][5:], largest[~past][5:]), (1.6 + ahead[5:], 3.1 + ahead[5:]))
    short = replace(frame, band_ahead=-0.7 + later)  # it ends before the preview does, half a second ahead
    beyond = x > 0.55
    assert all((quantile[beyond] == shown[beyond]).all() for quantile in short.spread(x, [shown], [line]))
    assert (short.spread(x, [shown], [line])[0][~past & ~beyond] < shown[~past & ~beyond]).all()
    alone = replace(frame, band=None)
    assert all((quantile == shown).all() for quantile in alone.spread(x, [shown], [line]))


def test_a_preview_that_the_run_has_followed_meanwhile_is_drawn_from_now_on() -> None:
    """Without an edit, line ahead and run are the same, however long ago the preview was requested."""
    loop = ran(shipped()["ur5-hybrid"], 0.3)
    earlier = snapshot_of(loop)
    for _ in range(200):
        loop.step()
    preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), loop.system.scenario, 1.0))
    preview_run.advance(10_000)
    preview = preview_run.preview()
    assert isinstance(preview, Preview)
    for _ in range(300):
        loop.step()
    seen = snapshot_of(loop)
    for _ in range(700):
        loop.step()
    plots = Plots(MagicMock(), VisibleParts(), Viewing(), nullcontext())
    frame = plots._frame(seen, Shown(seen.t, 2.0, preview=preview, horizon=1.0))
    x, desired, s = frame.courses(
        [ChartLine(name, (0, 0, 0), column(*of)) for name, *of in (("r_d", "r_d", 1), ("s", "s_norm"))]
    )
    run, ahead = loop.recording.stretch(), x > 0.0
    assert 0.68 < x[-1] < 0.7
    for drawn, values in ((desired, run["r_d"][:, 1]), (s, run["s_norm"])):
        np.testing.assert_allclose(drawn[ahead], np.interp(seen.t + x[ahead], run["t"], values), rtol=1e-9, atol=1e-12)
    begun_anew = replace(preview, restarts=True)
    x, _ = plots._frame(seen, Shown(seen.t, 2.0, preview=begun_anew, horizon=1.0)).courses(
        [ChartLine("s", (0, 0, 0), column("s_norm"))]
    )
    np.testing.assert_array_equal(x[x > 0.0], preview.ahead)
    shown: list[Shown] = []
    plots._frame = lambda _, of: shown.append(of)  # pyright: ignore[reportAttributeAccessIssue]
    for at, of in ((earlier, preview), (seen, preview), (earlier, begun_anew)):  # after a look back nothing lies ahead
        plots.show(at, Shown(at.t, 2.0, preview=of, horizon=1.0), ["Tracking"])
    assert [of.preview is None for of in shown] == [True, False, False]
    assert [of.now for of in shown] == [earlier.t, preview.since, earlier.t]  # so that its first instants are seen
