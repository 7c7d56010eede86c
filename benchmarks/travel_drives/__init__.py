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

"""Drives whose direction of travel is known: are the yaw and the pitch against it true?

It was written from the public interface (issue 22), without a look at how they are estimated. Roads bend,
rise and fall to a side (:mod:`.ways`); a car drives on them on its tyres and springs (:mod:`.cars`), kept in
its lane by a driver (:mod:`.driving`). Streets stand along the roads (:mod:`.streets`), and both cameras
film them (:mod:`.filming`). The drives of a series (:mod:`.kinds`) go through the calibrator, frame by frame,
and are judged (:mod:`.judged`), and so are recorded ones (:mod:`.recorded`).
"""
