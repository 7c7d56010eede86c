"""The estimator: numpy and OpenCV only, no ROS, no files (a test enforces it)."""
