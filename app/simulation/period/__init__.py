"""One control period of the arm and its controller, step by step in Python and compiled."""
