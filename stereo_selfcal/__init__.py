"""Self-calibration of a vehicle's stereo camera over the road, from painted lane lines.

Importing this package imports no ROS: the node lives in :mod:`stereo_selfcal.ros`.
"""

from .core.calibrator import Calibrator, calibrate
from .core.config import CalibratorConfig
from .core.errors import ConfigError, ImageError, RigError, SelfcalError
from .core.extrinsics import Extrinsics
from .core.results import CalibrationResult, Rejection, RejectReason
from .core.rig import StereoRig

__version__ = "0.1.0"

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
