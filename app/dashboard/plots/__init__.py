"""The dock of plots, and the same plots on paper."""
