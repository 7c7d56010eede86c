# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Prior knowledge about roads and rigs: numbers, each with its origin."""

from __future__ import annotations

import math

# Most distance of an extra line from the lane's boundaries: the width of one more motorway lane. Lines
# farther aside may belong to another road.
LANE_WIDTH_M = 3.75
# Most cross fall of a road against the slope of the own lane. Roads fall by up to 2.5 % from their middle to
# both sides, so beyond a crown the slope differs by twice that.
MAX_CROSS_FALL = 0.05
# Most height of a crown over the plane through the outer lines of two lanes. A line that seems to lie higher
# is a wrong match of two lines.
MAX_CROWN_M = MAX_CROSS_FALL * LANE_WIDTH_M
# The maximum is taken as two standard deviations.
CROSS_FALL_STD = MAX_CROSS_FALL / 2.0
# Lean of a car on the cross fall of its road: 5 deg for each g (Milliken and Milliken, Race Car Vehicle
# Dynamics, 1995, chapter 16: 1 deg of sports cars to 8 deg of soft ones), where one road falls by 1 % more
# than others.
LEAN_STD_RAD = 0.01 * math.radians(5.0)
# Least width of a lane beside another one: narrower lanes exist at road works only.
MIN_LANE_WIDTH_M = 2.5
# Most distance between the middles of the lines of one lane: the widest motorway lane, 3.75 m, and the widest
# line, 0.30 m. Lines farther apart enclose more than one lane, whatever lies between them.
MAX_LANE_WIDTH_M = 4.05
# Standard deviation of a line's height over the plane of two other lines of its lane. In the accepted
# recorded frames, the worse of two boundaries differs by 13 mm (RMS) in height from the road surface between
# them. So each of them deviates by about 10 mm.
LINE_HEIGHT_STD_M = 0.010
# Calibrations of stereo cameras end with reprojection errors of a tenth of a pixel.
RECTIFICATION_STD_PX = 0.1
# Standard deviations of the angles by which a right camera is turned against its calibration: pitch (rows),
# roll, yaw (vergence). In the frames of KITTI, whose calibrations are of several days, the rows tell a pitch
# of 0.009 deg and a roll of 0.025 deg (RMS), those of four other cameras 0.015 and 0.03; a tenth of a pixel
# is 0.008 deg.
CALIBRATED_TURN_STD_RAD = (math.radians(0.015), math.radians(0.02), math.radians(0.01))
VERGENCE_STD_RAD = CALIBRATED_TURN_STD_RAD[2]
# Of ten pairs on vehicles, about one has turned in yaw since it was calibrated, by a bump, by warming or
# by a wrong assembly. No statistics are known: so much that a frame with clear evidence is believed, and so
# little that one without is worth its calibration.
TURNED_PART, TURNED_STD_RAD = 0.1, math.radians(0.15)
# The same of pitch and roll, which rows show at once: such pairs are calibrated again, and fewer are left.
TURNED_ROWS_PART = 0.05
# How often the two clearest lines on a road, as far apart as those of a lane, are paint that is parallel;
# others meet anywhere.
PARALLEL_PART = 0.75
# The same of two lines whose grey values are those of painted stripes, and which lie on any one flat road.
STRIPES_PARALLEL_PART = 0.95
# How far a car moves sideways for each metre that it drives, as a camera in it sees it: it drifts in its lane
# by 0.3 m/s at 50 km/h, and cameras are mounted straight to a degree (standard deviation).
SIDEWAYS_PART = 0.02
USUAL_SPEED_MPS = 50.0 / 3.6
# The same for each second, where the way between two images is not known.
SIDEWAYS_MPS = SIDEWAYS_PART * USUAL_SPEED_MPS
# Mean distance of the farthest thing that is seen along a road: half of 42 recorded frames show nothing
# farther than 190 m, whose median of an exponential distribution of the disparity is.
FARTHEST_M = 130.0
# Standard deviation of the direction of the baseline, up and ahead: in the same frames, the rows of near
# points tell 5 mrad.
BASELINE_DIRECTION_STD_RAD = 0.005
# Standard deviation of the yaw that the rows of a calibrated pair tell, as lenses are not known exactly. The
# rows of six cameras on roads tell 0.00 to 0.12 deg in the mean, which their disparities do not show, and
# those of single frames scatter by 0.06 deg around that.
ROW_YAW_STD_RAD = math.radians(0.12)
# How often they tell it at all: those of a seventh camera, of the same make, tell 0.5 deg.
ROWS_TELL_YAW_PART = 6 / 7
# Standard deviation of the angle between painted lines. On the plane of the road surface, the lines of 12
# recorded roads meet at an angle of 5 mrad (RMS). Such a lane is 5 cm wider after 10 m.
PAINT_ANGLE_STD_RAD = 0.005
# Standard deviation of the height of a line that is paint or a kerb, at even odds: half the height of a kerb,
# of which the lowest have 6 cm, and usual ones 12 cm.
KERB_DOUBT_STD_M = 0.06
# Half the width of the strip under the car: lanes are a quarter of a metre wider on either side, at least.
HALF_STRIP_M = 1.0
HALF_LANE_WIDTH_M = 1.75  # half the width of a usual lane
# How a car moves its camera over the road on a usual ride: standard deviations of height [m], pitch and roll
# [rad], and how long a state lasts. Springs move a car by millimetres, braking and driving off pitch it by
# tenths of a degree, cambers roll it. Bodies ring at 1 to 2 Hz and are damped within one or two periods;
# brakes are applied for seconds. The poses of 20 recorded frames of a motorway scatter by 7 mm, 0.09 and
# 0.19 deg.
RIDE_STD = (0.005, math.radians(0.15), math.radians(0.2))
RIDE_MEMORY_S = 1.5
# What the place of a standing car does, whose springs rest: unevenness of 3 mm under wheels that are 2.7 m
# and 1.6 m apart (0.06, 0.1 deg), and a vertical curve of 10 km radius up to the road ahead (0.07 deg).
STANDING_STD = (0.003, math.radians(0.1), math.radians(0.1))
# The same of what a car can do at all: brakes and acceleration pitch it by 2 deg, a bend rolls it by 5 deg
# (Milliken and Milliken, as above), a hump lifts it by the travel of its springs. These are taken as three
# standard deviations.
HARD_RIDE_STD = (0.10 / 3.0, math.radians(2.0 / 3.0), math.radians(5.0 / 3.0))
