"""The outcome of a recording as a recording: what ``replay --mcap`` writes, without ROS."""

SUFFIX = ".mcap"  # of the file
