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

"""The exceptions of this package."""

from ..core.errors import SelfcalError, printable


class BagError(SelfcalError):
    """A recording cannot be used: missing, damaged, or without a stereo pair.

    Args:
        message: One sentence. Names in it may come from the recording: what cannot be printed is escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class NoFileError(BagError):
    """Something else is where a file is needed: a folder, a pipe, a device."""


class TooLargeError(BagError):
    """A recording states a size that no recording of cameras has, so that it is not read further."""
