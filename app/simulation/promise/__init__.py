"""The promise of Theorem 1 while a run goes: its premises, the true arm's errors, and whether it was kept."""
