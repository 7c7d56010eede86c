"""Frames over time: their mean, the motion of the car, and moves of the mount."""
