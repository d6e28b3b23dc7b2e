"""Grid lines of a chart in SVG, each with its label beside it."""

from __future__ import annotations


def upright(x: float, top: int, bottom: int, label: str) -> str:
    """Vertical line at x from `top` to `bottom`, px, with its label below."""
    return (
        f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{bottom}"/>'
        f'<text x="{x:.1f}" y="{bottom + 13}" text-anchor="middle">{label}</text>'
    )


def level(y: float, left: int, right: int, label: str) -> str:
    """Horizontal line at y from `left` to `right`, px, with its label before it."""
    return (
        f'<line class="grid" x1="{left}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>'
        f'<text x="{left - 4}" y="{y + 3.5:.1f}" text-anchor="end">{label}</text>'
    )
