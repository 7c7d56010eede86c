"""A second generator of stereo worlds, written without a look at the estimator or at the first one."""

from .worlds import World, draw, kinds

__all__ = ["World", "draw", "kinds"]
