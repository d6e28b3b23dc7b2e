"""Analysis of recordings: metrics, spectra, events, and quantities that only the simulation knows."""
