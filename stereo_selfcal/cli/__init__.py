"""Command line tools that need no ROS graph."""

from ..blas import one_thread

one_thread()
