"""Hypotheses about the lines of a frame: their order, their solution and the choice among attempts."""
