"""Pictures for people: views of a frame, what is said of it in words, and both composed. They need no ROS."""
