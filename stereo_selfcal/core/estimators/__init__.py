"""Estimators of the pose: each takes images or lines, and returns a pose with its covariance."""
