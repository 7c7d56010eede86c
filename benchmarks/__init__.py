"""Accuracy, speed and the alternatives, measured; `make bench` writes benchmarks/results/."""

import os

# Every method gets one thread, so that times can be compared; it must be said before NumPy is imported.
for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ[f"{_library}_NUM_THREADS"] = "1"
