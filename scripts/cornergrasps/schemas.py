"""JSON Schemas of grippers and robots, with which editors complete and check them."""

from __future__ import annotations

import sys

from cornergrasps.recipes import Gripper, Robot
from cornerscenes.schemas import write_schemas

KINDS = {"gripper": Gripper, "robot": Robot}

if __name__ == "__main__":
    sys.exit(write_schemas("cornergrasps.schemas", KINDS))
