"""Synthetic stereo pictures of a road, with their truth; no ROS."""
