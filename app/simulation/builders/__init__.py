"""What builds the parts of a system from the sections of a scenario, and refuses those that cannot run."""
