"""MuJoCo: the only module that imports it. Its own stubs do not tell its names."""

from __future__ import annotations

from typing import Any, TypeAlias

import mujoco

mj: Any = mujoco

# Warnings are counted in a simulation's state, where they are looked at: without this they go to a
# file in whatever folder the process runs in.
mj.set_mju_user_warning(lambda message: None)

# A compiled model, the state of a simulation, a model that is being made, and a body of one.
CompiledModel: TypeAlias = Any
Data: TypeAlias = Any
Spec: TypeAlias = Any
Body: TypeAlias = Any
