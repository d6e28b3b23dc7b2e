"""Desired paths r_d(t): each file is one, a row of `table.TRAJECTORIES`.

A path is a displacement from where it starts, with two exact derivatives.
"""
