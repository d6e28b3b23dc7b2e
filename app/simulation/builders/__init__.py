"""Builders of the parts of a system from the sections of a scenario, and checks that refuse those that cannot run."""
