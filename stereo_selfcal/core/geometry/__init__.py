"""Pose of the rig over the road, the road's plane, and what projects one into the other."""
