"""VSMRC Lab: scenarios, the closed loop, its runner, the command line and the dashboard."""
