"""The control laws, one file each, named here in the order of the page's menu. A law is the `LAW` of its file."""

from __future__ import annotations

KINDS = ("vsmrc", "computed-torque", "pd-gravity")  # of a-kind, the file is a_kind.py
