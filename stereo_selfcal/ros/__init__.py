"""The ROS 2 front of the package: the node, and the demo that calls it. Nothing else imports rclpy."""

from ..blas import one_thread

one_thread()
