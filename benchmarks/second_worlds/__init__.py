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

"""A second generator of stereo worlds, written without a look at the estimator or at the first one.

Everything is a flat polygon of three or four corners (:mod:`mesh`). The nearest one of each pixel is found
by its inverse depth, which is linear in the image; silhouettes have sixteen samples a pixel (:mod:`raster`).
Light is computed where a pixel meets the world, for each camera by itself: textures are functions of the
place, filtered for the length a pixel has there (:mod:`textures`), and the edges of paint are integrated over
the square of the pixel (:mod:`ground`). A wet road is rendered a second time with everything mirrored in it
(:mod:`shading`).

A kind (:mod:`kinds`, :mod:`shapes`, :mod:`streets`, :mod:`weather`, :mod:`traps`) draws an ordinary road
(:mod:`drafts`) and changes what makes it this kind. The truth is the plane of the own lane 3 to 15 m ahead,
by least squares; where the lane leaves it by more than 15 mm a world is not good (:mod:`worlds`).
"""

from .worlds import World, draw, kinds

__all__ = ["World", "draw", "kinds"]
