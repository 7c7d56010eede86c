"""What is published of a calibration, as plain values that need no ROS.

The node and ``replay --mcap`` make their messages of these values, so that both say the same.
"""
