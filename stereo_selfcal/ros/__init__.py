"""The ROS 2 front of the package: the node, and the demo that calls it. Nothing else imports rclpy."""
