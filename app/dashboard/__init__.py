"""The page: the only code that knows viser."""

from app.dashboard.page import Dashboard, PortBusy

__all__ = ["Dashboard", "PortBusy"]
