"""Widgets about many runs: choice of the true arm, robustness map, search for better gains."""
