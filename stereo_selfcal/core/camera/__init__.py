"""Cameras as messages describe them: intrinsics, images, rectification, pairs in time, the rig."""
