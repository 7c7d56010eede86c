"""What is known of roads before one is seen: numbers, each with its origin."""

from __future__ import annotations

# A line of the next lane is asked as well; beyond, other roads begin.
LANE_M = 3.75
# Roads fall by up to 2.5 % from their middle to both sides: beyond a crown, by as much as twice that against
# the slope of the own lane.
GREATEST_FALL = 0.05
# Between the outer lines of two lanes. What lies higher over their plane is no line, but two taken for one.
HIGHEST_CROWN_M = GREATEST_FALL * LANE_M
# What is said to be the greatest is taken as two standard deviations.
FALL_STD = GREATEST_FALL / 2.0
# Two lanes side by side are at least this wide each: less is found at road works only.
NARROWEST_LANE_M = 2.5
# Between the middles of the lines of one lane there is at most this: the widest of motorways, 3.75 m, and the
# widest line, 0.30 m. Lines farther apart are not of one lane alone, whatever the other part is.
WIDEST_LANE_M = 4.05
# Height of a line over the plane of two others of its lane. The worse of two boundaries lies 13 mm (RMS)
# beside the asphalt between them in the recorded frames that are accepted, so each of them about 10 mm.
UNEVEN_STD_M = 0.010
# Calibrations of stereo cameras end with reprojection errors of a tenth of a pixel.
RECTIFICATION_STD_PX = 0.1
# Painted lines are parallel only so far: on the plane of the asphalt, those of 12 recorded roads meet at an
# angle of 5 mrad (RMS), as a lane does that is 5 cm wider after 10 m.
PAINT_STD_RAD = 0.005
HALF_LANE_M = 1.75  # of a usual one
