"""Arguments of the programs that need ROS."""

from __future__ import annotations

import argparse
from typing import NoReturn

from ..core.errors import ConfigError


class RosParser(argparse.ArgumentParser):
    """Argument parser that leaves it to the program to tell a wrong argument: in one line, and printable."""

    def error(self, message: str) -> NoReturn:
        """Raise instead of printing the argument as it was given."""
        raise ConfigError(f"{message}; see --help")
