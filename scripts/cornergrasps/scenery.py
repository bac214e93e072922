"""A rendered scene rebuilt from its scene.json: target, room, and what stands around."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from cornergrasps.clutter import is_soft, surface_points
from cornerscenes.camera import transformed
from cornerscenes.layout import REDRAWN
from cornerscenes.objects import BUILDERS
from cornerscenes.scene import FIRST_OBJECT_ID
from cornerscenes.shape import Part
from cornerscenes.storage import StorageError
from cornerscenes.streams import stream

# Places of the room that a robot's platform must not cover, no farther apart than this [m].
_SPACING_M = 0.03


class SceneError(StorageError):
    """A scene that cannot be rebuilt; the message says why."""


@dataclass(frozen=True)
class Thing:
    """An object beside the target.

    Attributes
    ----------
    name : str
        Its kind and number.
    parts : tuple[Part, ...]
        Its meshes, in its own frame.
    world_from_object : Float[np.ndarray, "4 4"]
        Its pose.
    """

    name: str
    parts: tuple[Part, ...]
    world_from_object: Float[np.ndarray, "4 4"]

    def obstacle_points_m(self) -> Float[np.ndarray, "n 3"]:
        """Return points in the world, close together, on what of it does not give way."""
        found = [
            surface_points(part.vertices, part.triangles, _SPACING_M)
            for part in self.parts
            if not is_soft(part)
        ]
        return transformed(self.world_from_object, np.concatenate([np.zeros((0, 3)), *found]))


@dataclass(frozen=True)
class Scenery:
    """A scene as physics needs it.

    Attributes
    ----------
    name : str
        The scene's.
    key : str
        What its random streams start from.
    size_m : Float[np.ndarray, "3"]
        The cuboid's extent along its own axes; it stands on its own z = 0, about its z axis.
    world_from_target : Float[np.ndarray, "4 4"]
        Its pose.
    things : tuple[Thing, ...]
        What stands around it.
    surfaces_m : dict[str, Float[np.ndarray, "4 3"]]
        Floor and walls by their corners.
    world_from_camera : Float[np.ndarray, "4 4"]
        The colour camera's pose.
    """

    name: str
    key: str
    size_m: Float[np.ndarray, "3"]
    world_from_target: Float[np.ndarray, "4 4"]
    things: tuple[Thing, ...]
    surfaces_m: dict[str, Float[np.ndarray, "4 3"]]
    world_from_camera: Float[np.ndarray, "4 4"]

    @classmethod
    def read(cls, folder: Path) -> Scenery:
        """Return the scene that a folder of a dataset holds.

        Raises
        ------
        SceneError
            When it is missing, is no cuboid's, or its objects are not those that are built here.
        """
        try:
            content = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
            return cls._of(folder.name, content)
        except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
            raise SceneError(f"{folder / 'scene.json'}: {type(error).__name__}: {error}") from error

    @classmethod
    def _of(cls, name: str, content: dict[str, Any]) -> Scenery:
        target = content["target"]
        if target["kind"] != "cuboid":
            raise SceneError(f"{name}: its target is a {target['kind']}, only cuboids are grasped")
        return cls(
            name=name,
            key=content["key"],
            size_m=np.array(target["size_m"]),
            world_from_target=_pose(target["world_from_target"]),
            things=_things(name, content),
            surfaces_m={
                surface["name"]: np.array(surface["corners_m"])
                for surface in content["surfaces"]
                if surface["name"] != "stripe"
            },
            world_from_camera=_pose(content["world_from_camera"]),
        )

    @property
    def is_held(self) -> bool:
        """Whether the target stands on nothing: something holds it until the jaws have closed."""
        return "floor" not in self.surfaces_m

    @cached_property
    def centre_m(self) -> Float[np.ndarray, "3"]:
        """The middle of the target in the world."""
        return transformed(self.world_from_target, np.array([[0.0, 0.0, 0.5 * self.size_m[2]]]))[0]

    @cached_property
    def obstacle_points_m(self) -> Float[np.ndarray, "n 3"]:
        """Points in the world on what stands around, the target among it."""
        steps = np.linspace(0.0, 1.0, 8)
        shares = np.stack([axis.ravel() for axis in np.meshgrid(steps, steps, steps)], axis=1)
        box = (shares - [0.5, 0.5, 0.0]) * self.size_m
        own = transformed(self.world_from_target, box)
        return np.concatenate([own, *(thing.obstacle_points_m() for thing in self.things)])


def _pose(rows: list[list[float]]) -> Float[np.ndarray, "4 4"]:
    return np.vstack([np.array(rows, dtype=np.float64).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])


def _things(name: str, content: dict[str, Any]) -> tuple[Thing, ...]:
    """Build the objects anew: a file names builder, height and stream, not their meshes.

    A scene whose objects could not be placed was drawn again under another name; which, the number
    of triangles tells.
    """
    described = content["objects"]
    for prefix in ("", *(f"redrawn{count}." for count in range(REDRAWN))):
        built = [_parts(content["key"], prefix, item) for item in described]
        counts = [sum(len(part.triangles) for part in parts) for parts in built]
        if counts == [item["triangles"] for item in described]:
            return tuple(
                Thing(
                    f"{item['builder']} {item['object_id']}",
                    parts,
                    _pose(item["world_from_object"]),
                )
                for item, parts in zip(described, built, strict=True)
            )
    raise SceneError(
        f"{name}: its objects are not those that this version builds; render the dataset again"
    )


def _parts(key: str, prefix: str, item: dict[str, Any]) -> tuple[Part, ...]:
    number = item["object_id"] - FIRST_OBJECT_ID
    generator = stream(key, f"{prefix}object{number}", item["builder"])
    return BUILDERS[item["builder"]](generator, item["height_m"])
