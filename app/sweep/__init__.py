"""Sweeps: the same scenario with many settings and many true arms."""
