"""MuJoCo: the only module that imports it. Its own stubs do not tell its names."""

from __future__ import annotations

from typing import Any, TypeAlias

import mujoco

mj: Any = mujoco

# A compiled model, the state of a simulation, a model that is being made, and a body of one.
CompiledModel: TypeAlias = Any
Data: TypeAlias = Any
Spec: TypeAlias = Any
Body: TypeAlias = Any
