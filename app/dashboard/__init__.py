"""The page: the only code that knows viser."""

from app.dashboard.page import Dashboard, PortBusy, check_fps

__all__ = ["Dashboard", "PortBusy", "check_fps"]
