"""What speaks for and against an estimate: measurements, gates, terms of its uncertainty, cross-checks."""
