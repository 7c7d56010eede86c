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

"""Self-calibration of a vehicle's stereo camera over the road, from painted lane lines.

Importing this package imports no ROS: the node lives in :mod:`stereo_selfcal.ros`.
"""

from .search_path import leave_current_folder

leave_current_folder()

from importlib import import_module  # noqa: E402 - not before: the current folder could have one, and a typing
from typing import TYPE_CHECKING, Any  # noqa: E402

if TYPE_CHECKING:
    from .core.calibrator import Calibrator, calibrate
    from .core.camera.rig import StereoRig
    from .core.config import CalibratorConfig
    from .core.errors import ConfigError, ImageError, RigError, SelfcalError
    from .core.geometry.pose import Extrinsics
    from .core.rejection import Rejection, RejectReason
    from .core.results import CalibrationResult

__version__ = "0.2.0"

__all__ = [
    "CalibrationResult",
    "Calibrator",
    "CalibratorConfig",
    "ConfigError",
    "Extrinsics",
    "ImageError",
    "RejectReason",
    "Rejection",
    "RigError",
    "SelfcalError",
    "StereoRig",
    "__version__",
    "calibrate",
]

# These are imported on first use, because our own programs have to set up BLAS before numpy is imported.
_MODULES = {
    "CalibrationResult": "results",
    "Calibrator": "calibrator",
    "CalibratorConfig": "config",
    "ConfigError": "errors",
    "Extrinsics": "geometry.pose",
    "ImageError": "errors",
    "RejectReason": "rejection",
    "Rejection": "rejection",
    "RigError": "errors",
    "SelfcalError": "errors",
    "StereoRig": "camera.rig",
    "calibrate": "calibrator",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".core.{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})
