"""Scenes that the tests build by hand, and the slow, obvious ray cast they are checked with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cornerscenes import board, cuboid, room
from cornerscenes.camera import Camera, looking_at, standing, transformed
from cornerscenes.light import Light
from cornerscenes.scene import FIRST_OBJECT_ID, Line, PlacedObject, Scene, Shape
from cornerscenes.shape import Material, Part
from cornerscenes.target import Target

RED = Material((0.6, 0.02, 0.02))
SIZE = (0.16, 0.12, 0.18)
WHITE_SKY = Light((1, 1, 1), (1, 1, 1), (1, 1, 1), ())
CAMERA = Camera.with_field_of_view(96, 80, 40.0)
NOTHING = np.zeros((0, 3))


def target(bevel_radius_m: float = 0.0) -> Target:
    """Return a cuboid on the floor."""
    parts = (
        cuboid.bevelled(SIZE, bevel_radius_m, RED) if bevel_radius_m else cuboid.sharp(SIZE, RED)
    )
    pose = standing(0.2, 0.22, 0.35)
    return Target("cuboid", SIZE, cuboid.wireframe(SIZE), parts, pose, bevel_radius_m, NOTHING)


def checkerboard() -> Target:
    """Return a board of 5 x 3 squares that lies on the floor."""
    size = board.size_m(5, 3, 0.03)
    parts = board.parts(5, 3, 0.03, None)
    pose = standing(0.2, 0.22, 0.35)
    return Target("board", size, board.wireframe(5, 3, 0.03), parts, pose, 0.0, NOTHING)


def slab(
    pose: np.ndarray | None = None,
    size: tuple[float, float, float] = (0.02, 0.10, 0.16),
    object_id: int = FIRST_OBJECT_ID,
) -> PlacedObject:
    """Return a thin upright board; where no pose is given it stands before part of the target."""
    triangles = np.array([[f[0], f[k], f[k + 1]] for f in cuboid.FACES for k in (1, 2)])
    part = Part("board", cuboid.vertices(size), triangles, RED, smooth=False)
    pose = standing(0.08, 0.09, 0.9) if pose is None else pose
    return PlacedObject(object_id, "board", "occluder", size[2], Shape.of((part,)), pose)


def scene(*objects: PlacedObject, **changes: object) -> Scene:
    """Return a cuboid on a floor before two walls, and objects."""
    corners = room.corners(0.45, 0.45, 3.0, 1.4)
    paint = np.full((2, 2, 3), 0.5)
    inner = corners["floor"][2]
    lines = (
        Line("floor and wall_x", inner, corners["wall_x"][1]),
        Line("floor and wall_y", inner, corners["wall_y"][0]),
        Line("wall_x and wall_y", inner, corners["wall_x"][3]),
    )
    pose = looking_at(np.array([-0.35, -0.3, 0.6]), np.array([0.2, 0.22, 0.09]))
    drawn = Scene(
        camera=CAMERA,
        range_camera=Camera.with_field_of_view(12, 10, 40.0),
        world_from_camera=pose,
        world_from_range=pose,
        lens=None,
        target=target(),
        objects=objects,
        surfaces=tuple(room.Surface(name, four, paint) for name, four in corners.items()),
        lines=lines,
        light=WHITE_SKY,
        names={},
        is_red=True,
    )
    return replace(drawn, **changes)  # pyright: ignore[reportArgumentType]


def triangles_of(drawn: Scene, with_target: bool = True) -> np.ndarray:
    """Every triangle of target and objects in the world [m], shape (n, 3, 3)."""
    solids = [(item.shape.parts, item.world_from_object) for item in drawn.objects]
    if with_target:
        solids.append((drawn.target.parts, drawn.target.world_from_target))
    found = [
        transformed(pose, part.vertices)[part.triangles] for parts, pose in solids for part in parts
    ]
    return np.concatenate([np.zeros((0, 3, 3)), *found])


def is_hidden(eye: np.ndarray, point: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a segment from eye to point meets a triangle before its end: by the signs of volumes.

    The segment crosses the triangle's plane, and passes each of its sides on the same hand.
    """
    a, b, c = (triangles[:, k] - eye for k in range(3))
    ray = point - eye

    def volume(one: np.ndarray, other: np.ndarray, third: np.ndarray) -> np.ndarray:
        return np.einsum("...j,...j->...", np.cross(one, other), third)

    hands = np.stack([volume(a, b, ray), volume(b, c, ray), volume(c, a, ray)], axis=1)
    through = (hands > 0).all(axis=1) | (hands < 0).all(axis=1)
    # Where along the segment, 0 at the eye and 1 at its end.
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.einsum("ij,ij->i", normal, a) / (normal @ ray)
    return bool((through & (share > 0) & (share < 1 - 1e-7)).any())
