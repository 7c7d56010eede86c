"""What speaks for and against an estimate: measurements, gates, uncertainties, cross-checks."""
