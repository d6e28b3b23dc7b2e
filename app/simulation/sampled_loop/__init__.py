"""The sampled closed loop, linearised: its stability, force loop, frequencies and response to a push."""
