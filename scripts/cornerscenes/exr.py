"""Writing planes as OpenEXR: float32 or uint32, zip-compressed, nothing lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR


@dataclass(frozen=True)
class Layer:
    """One part of a file.

    Attributes
    ----------
    name : str
        Name of the part.
    channels : Mapping[str, np.ndarray]
        Planes of shape (height, width), float32 or uint32, by channel name.
    """

    name: str
    channels: Mapping[str, np.ndarray]


def write(path: Path, layers: tuple[Layer, ...], attributes: Mapping[str, str]) -> None:
    """Write layers, each with its own resolution, as the parts of one file.

    Parameters
    ----------
    path : Path
        Where to.
    layers : tuple[Layer, ...]
        At least one; the first one's size is the display window.
    attributes : Mapping[str, str]
        Written into every header.

    Raises
    ------
    TypeError
        For a plane that is neither float32 nor uint32: a silent conversion would lose digits.
    ValueError
        For a float plane with a value that is not finite.
    """
    display = _window(next(iter(layers[0].channels.values())))
    parts = []
    for layer in layers:
        planes = {name: np.ascontiguousarray(plane) for name, plane in layer.channels.items()}
        for name, plane in planes.items():
            if plane.dtype not in (np.float32, np.uint32):
                raise TypeError(f"{path}: {layer.name}.{name} is {plane.dtype}, must be float32")
            if plane.dtype == np.float32 and not np.isfinite(plane).all():
                raise ValueError(f"{path}: {layer.name}.{name} holds values that are not finite")
        header = {
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "displayWindow": display,
            "dataWindow": _window(next(iter(planes.values()))),
            **attributes,
        }
        parts.append(OpenEXR.Part(header, planes, name=layer.name))
    with OpenEXR.File(parts) as file:
        file.write(str(path))


def _window(plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    height, width = plane.shape
    return np.zeros(2, dtype=np.int32), np.array([width - 1, height - 1], dtype=np.int32)
