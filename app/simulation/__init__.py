"""Simulation of the closed loop as a computation: a scenario in, a recording out; no thread, no process, no file."""
