"""Frames over time: their mean, the motion of the car, moves of the mount."""
