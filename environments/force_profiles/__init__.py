"""Desired normal forces F_cd(t): each file is one, a row of `table.FORCE_PROFILES`."""
