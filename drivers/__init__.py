"""Clients that drive a server from outside, for tests, benchmarks and pictures: a browser, visitors, viser's
protocol."""
