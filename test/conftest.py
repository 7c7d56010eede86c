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

"""What all tests share: frames that are rendered once, and one thread for each process of `make test`."""

import os
import signal
from functools import cache

# Before numpy is imported: as many processes as there are cores run tests, and those of tests inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
import pytest
from hypothesis import settings

from stereo_selfcal import calibrate
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

cv2.setNumThreads(1)

# A slow machine is no fault.
settings.register_profile("any_machine", deadline=None)
settings.load_profile("any_machine")

# A script starts what runs in the background with SIGINT ignored, and nohup with SIGHUP; the programs under
# test inherit it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@cache
def _rendered(pose_seed, noise_fraction):
    scene = random_scene(np.random.default_rng(pose_seed), noise_fraction)
    # Another seed for the noise than for the pose, and a fixed one: the same picture in every run.
    images = render(scene, np.random.default_rng(1000 + pose_seed))
    for image in images:
        image.flags.writeable = False
    return scene, *images


@cache
def _calibrated(pose_seed, noise_fraction):
    scene, left, right = _rendered(pose_seed, noise_fraction)
    return scene, calibrate(left, right, scene.rig)


@pytest.fixture(scope="session")
def rendered():
    """Return a function (pose seed, noise) -> (scene, left, right); frames are rendered once."""
    return _rendered


@pytest.fixture(scope="session")
def calibrated():
    """Return a function (pose seed, noise) -> (scene, result of calibrate())."""
    return _calibrated
