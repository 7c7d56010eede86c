"""Which lines are tried, in which order, and what becomes of each."""
