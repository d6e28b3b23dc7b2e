"""Tables of Theorem 1 in numbers, and its symbols."""
