"""Accuracy and speed, measured; `make bench` writes benchmarks/results/."""
