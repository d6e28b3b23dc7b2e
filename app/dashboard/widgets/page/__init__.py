"""Widgets of the page itself: status, refusals, keys and help, the last session, downloads."""
