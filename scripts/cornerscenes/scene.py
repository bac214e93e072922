"""Everything that is resolved about a scene before it is rendered."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from cornerscenes.camera import Camera, inverse, transformed
from cornerscenes.light import Light
from cornerscenes.room import Surface
from cornerscenes.shape import Part
from cornerscenes.target import Target

TARGET_ID = 1
FIRST_OBJECT_ID = 10
FIRST_SURFACE_ID = 100

# Face id of what is not the target.
NO_FACE = 255

Role = Literal["occluder", "bystander", "distractor"]


@dataclass(frozen=True)
class Lens:
    """A thin lens in place of the pinhole: radius of its aperture, distance in focus [m]."""

    aperture_radius_m: float
    focus_distance_m: float

    def blur_radius_px(self, depth_m: float, focal_px: float) -> float:
        """Return the radius of the disc that a point at a depth [m] becomes."""
        return self.aperture_radius_m * focal_px * abs(1.0 / depth_m - 1.0 / self.focus_distance_m)


@dataclass(frozen=True)
class Shape:
    """An object as built, in its own frame [m], with what deciding on a place needs to know.

    Attributes
    ----------
    parts : tuple[Part, ...]
        Its meshes.
    vertices_m : Float[np.ndarray, "n 3"]
        The vertices of all parts.
    outline_m : Float[np.ndarray, "m 3"]
        Those that bound it seen from above.
    feet_middle_m, feet_radius_m
        A circle on the floor around all of it that is lower than 12 cm.
    """

    parts: tuple[Part, ...]
    vertices_m: Float[np.ndarray, "n 3"]
    outline_m: Float[np.ndarray, "m 3"]
    feet_middle_m: Float[np.ndarray, "3"]
    feet_radius_m: float

    @classmethod
    def of(cls, parts: tuple[Part, ...]) -> Shape:
        """Return the shape of an object's parts."""
        vertices = np.concatenate([part.vertices for part in parts])
        feet = vertices[vertices[:, 2] < 0.12][:, :2]
        middle = 0.5 * (feet.min(axis=0) + feet.max(axis=0))
        return cls(
            parts=parts,
            vertices_m=vertices,
            outline_m=vertices[ConvexHull(vertices[:, :2]).vertices],
            feet_middle_m=np.append(middle, 0.0),
            feet_radius_m=float(np.linalg.norm(feet - middle, axis=1).max()),
        )


@dataclass(frozen=True)
class PlacedObject:
    """One object of the scene."""

    object_id: int
    builder: str
    role: Role
    height_m: float
    shape: Shape
    world_from_object: Float[np.ndarray, "4 4"]

    @cached_property
    def feet_m(self) -> tuple[float, float]:
        """Where the middle of its feet is on the floor [m]."""
        x, y, _ = transformed(self.world_from_object, self.shape.feet_middle_m[None])[0]
        return float(x), float(y)


@dataclass(frozen=True)
class Line:
    """A straight line of the room where two of its surfaces meet, from end to end [m]."""

    name: str
    start_m: Float[np.ndarray, "3"]
    end_m: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class KnownCorners:
    """Points in the world [m] that look like corners and are none of the target's."""

    cause: Literal["texture", "distractor", "room"]
    name: str
    points_m: Float[np.ndarray, "k 3"]


@dataclass(frozen=True)
class Scene:
    """A scene.

    Attributes
    ----------
    camera, range_camera : Camera
        The colour camera and the range sensor.
    world_from_camera, world_from_range : Float[np.ndarray, "4 4"]
        Their poses.
    lens : Lens or None
        The colour camera's lens where it has one.
    target : Target
        What carries the true corners.
    objects : tuple[PlacedObject, ...]
        What stands around it.
    surfaces : tuple[Surface, ...]
        The room, and what hangs on its walls; none where the target floats in the sky.
    lines : tuple[Line, ...]
        The lines of the room.
    light : Light
        Sky and lamps.
    names : dict[str, str]
        Names of the pose, material, background and light that were drawn.
    is_red : bool
        Whether the target's colour is one that the paper's extraction finds in good light.
    """

    camera: Camera
    range_camera: Camera
    world_from_camera: Float[np.ndarray, "4 4"]
    world_from_range: Float[np.ndarray, "4 4"]
    lens: Lens | None
    target: Target
    objects: tuple[PlacedObject, ...]
    surfaces: tuple[Surface, ...]
    lines: tuple[Line, ...]
    light: Light
    names: dict[str, str]
    is_red: bool

    @property
    def eye_m(self) -> Float[np.ndarray, "3"]:
        """Where the colour camera stands in the world [m]."""
        return self.world_from_camera[:3, 3]

    def image_of(self, points_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Return the image points [px] of points in the world [m], which are before the camera."""
        return self.camera.project(transformed(inverse(self.world_from_camera), points_m))

    def known_corners(self) -> list[KnownCorners]:
        """Return what looks like a corner and is known to be none of the target's."""
        found = []
        if len(self.target.texture_corners_m):
            points = transformed(self.target.world_from_target, self.target.texture_corners_m)
            found.append(KnownCorners("texture", "label", points))
        found += [
            KnownCorners("texture", surface.name, surface.corners_m)
            for surface in self.surfaces
            if surface.is_decal
        ]
        for item in self.objects:
            for part in item.shape.parts:
                if part.corners_m is not None:
                    points = transformed(item.world_from_object, part.corners_m)
                    found.append(KnownCorners("distractor", item.builder, points))
        if self.lines:
            ends = np.stack([line.start_m for line in self.lines])
            found.append(KnownCorners("room", "corner of the room", np.unique(ends, axis=0)))
        return found
