"""Controllers: the theory of the paper, and nothing else; numpy in, numpy out. Names are its symbols, (n) its equation
numbers."""
