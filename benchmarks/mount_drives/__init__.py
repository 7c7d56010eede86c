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

"""Drives whose mount is known: is what a drive says of its mount true?

It was written from the public interface (issue 21), without a look at how the mount is estimated. Frames of
rendered and of recorded roads say how wrong frames are (:mod:`.frame_errors`). Cars drive, brake, stand and
lean on their springs (:mod:`.rides`), and frames are drawn for them (:mod:`.draws`). Their estimates are
judged (:mod:`.judged`), those of rendered drives (:mod:`.rendered`) and of recorded ones (:mod:`.recorded`).
"""
