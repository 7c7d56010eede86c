"""What any estimator could reach."""
