"""Placing objects about the target until as much of it is seen as is wanted.

Every object gets a number of places of its own, within what its role allows; from each, what it
hides of the target is cast once. Then combinations of places are drawn until the objects stand
clear of each other and the visible fraction is in its bounds: the first one that does is taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from cornerscenes.camera import inverse, standing, transformed
from cornerscenes.mitsuba_backend import Occluder
from cornerscenes.scene import PlacedObject
from cornerscenes.streams import stream
from cornerscenes.tables import RecipeError
from cornerscenes.target import Target

# Places of each object, positions tried for one of them, and combinations of places.
PLACES = 24
TRIES = 40
COMBINATIONS = 20_000

# Cells per side of a face from which a placement's visible fraction is estimated.
PLACEMENT_CELLS = 24

# Objects keep this distance from the target, the walls and each other's feet.
CLEARANCE_M = 0.012

# Bearing from the target [rad] and distance [m] of each role: an occluder stands about the line to
# the camera, a distractor to one side of it, a bystander anywhere in the room.
_PLACES = {
    "occluder": ((-1.3, 1.3), (0.12, 0.36)),
    "distractor": ((0.9, 1.9), (0.16, 0.40)),
    "bystander": ((-2.2, 2.2), (0.16, 0.70)),
}


def place(
    key: str,
    built: tuple[PlacedObject, ...],
    target: Target,
    eye_m: Float[np.ndarray, "3"],
    walls_m: Float[np.ndarray, "2"],
    wanted: tuple[float, float] | None,
) -> tuple[PlacedObject, ...]:
    """Return the objects, placed.

    Parameters
    ----------
    key : str
        Names the random streams.
    built : tuple[PlacedObject, ...]
        The objects, wherever they are.
    target : Target
        What they stand about.
    eye_m : Float[np.ndarray, "3"]
        Where the camera stands [m].
    walls_m : Float[np.ndarray, "2"]
        Where the walls across x and y stand [m].
    wanted : tuple[float, float] or None
        Bounds of the target's visible fraction; `None` where any will do.

    Raises
    ------
    RecipeError
        When no placement meets the bounds.
    """
    pools = [_places(key, item, target, eye_m, walls_m) for item in built]
    if not built:
        return ()
    points, weights = _facing_points(target, eye_m, PLACEMENT_CELLS)
    hidden = [_hidden(pool, eye_m, points if wanted else points[:0]) for pool in pools]
    low, high = wanted or (0.0, 1.0)
    nearest, found = np.inf, float("nan")
    generator = stream(key, "combination")
    for _ in range(COMBINATIONS):
        choice = [int(index) for index in generator.integers([len(pool) for pool in pools])]
        chosen = tuple(pool[index] for pool, index in zip(pools, choice, strict=True))
        if not all(_apart(a, b) for a, b in itertools.combinations(chosen, 2)):
            continue
        if wanted is None:
            return chosen
        masks = [mask[index] for mask, index in zip(hidden, choice, strict=True)]
        fraction = float(weights[~np.logical_or.reduce(masks)].sum() / weights.sum())
        distance = max(low - fraction, fraction - high, 0.0)
        if distance == 0.0:
            return chosen
        if distance < nearest:
            nearest, found = distance, fraction
    raise RecipeError(
        f"visible_fraction [{low:.3f}, {high:.3f}] not met by {COMBINATIONS} placements, "
        + ("objects do not fit" if np.isinf(nearest) else f"nearest {found:.3f}")
        + "; widen the range or move the family's occluders"
    )


def visible_fraction(
    target: Target,
    eye_m: Float[np.ndarray, "3"],
    hidden: Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]],
    count: int,
) -> float:
    """Return the share of the target's image area that nothing hides, whatever the frame cuts.

    Parameters
    ----------
    target : Target
        The target.
    eye_m : Float[np.ndarray, "3"]
        The camera's place in the world [m].
    hidden : Callable
        Says of points on the target [m] whether something stands before them.
    count : int
        Every face that looks at the camera is sampled on a grid of count x count cells.
    """
    points, weights = _facing_points(target, eye_m, count)
    return float(weights[~hidden(points)].sum() / weights.sum())


def _facing_points(
    target: Target, eye_m: Float[np.ndarray, "3"], count: int
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Return cell centres on the faces that look at an eye [m], and the solid angle of each."""
    points, weights = [], []
    for face in target.facing(eye_m):
        cells = target.face_points_m(face, count)
        towards = eye_m - cells
        area = np.prod(target.face_extent_m(face))
        points.append(cells)
        weights.append(
            area * (towards @ target.normal(face)) / np.linalg.norm(towards, axis=1) ** 3
        )
    return np.concatenate(points), np.concatenate(weights)


def _places(
    key: str,
    item: PlacedObject,
    target: Target,
    eye_m: Float[np.ndarray, "3"],
    walls_m: Float[np.ndarray, "2"],
) -> list[PlacedObject]:
    """Return an object in several places, each clear of target, walls and camera."""
    centre = target.world_from_target[:2, 3]
    towards_eye = _bearing(eye_m[:2] - centre)
    towards_room = _bearing(centre - walls_m) if np.isfinite(walls_m).all() else 0.0
    bearings, distances = _PLACES[item.role]
    generator = stream(key, item.object_id)
    found: list[PlacedObject] = []
    for _ in range(TRIES * PLACES):
        angle = generator.uniform(*bearings)
        if item.role == "distractor":
            angle *= generator.choice([-1.0, 1.0])
        angle += towards_room if item.role == "bystander" else towards_eye
        x, y = centre + generator.uniform(*distances) * np.array([np.cos(angle), np.sin(angle)])
        pose = standing(float(x), float(y), float(generator.uniform(-np.pi, np.pi)))
        candidate = replace(item, world_from_object=pose)
        if _fits(candidate, target, eye_m, walls_m):
            found.append(candidate)
            if len(found) == PLACES:
                break
    if not found:
        raise RecipeError(
            f"{item.builder} of {item.height_m:.2f} m fits nowhere about the target in "
            f"{TRIES * PLACES} tries; make it smaller or the room larger"
        )
    return found


def _hidden(
    pool: list[PlacedObject], eye_m: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"]
) -> list[Bool[np.ndarray, " n"]]:
    """Return which points on the target [m] an object hides from each of its places."""
    if not len(points):
        return []
    occluder = Occluder(pool[0].shape.parts)
    return [occluder.hides(item.world_from_object, eye_m, points) for item in pool]


def _bearing(direction: Float[np.ndarray, "2"]) -> float:
    return float(np.arctan2(direction[1], direction[0]))


def _fits(
    candidate: PlacedObject,
    target: Target,
    eye_m: Float[np.ndarray, "3"],
    walls_m: Float[np.ndarray, "2"],
) -> bool:
    """Whether an object keeps clear of walls, target and camera; cheap tests first."""
    outline = transformed(candidate.world_from_object, candidate.shape.outline_m)
    if (outline[:, :2].max(axis=0) > walls_m - 0.002).any():
        return False
    vertices = transformed(candidate.world_from_object, candidate.shape.vertices_m)
    inside = transformed(inverse(target.world_from_target), vertices)
    inside[:, 2] -= 0.5 * target.size_m[2]
    if (np.abs(inside) < 0.5 * np.array(target.size_m) + CLEARANCE_M).all(axis=1).any():
        return False
    return bool(np.linalg.norm(vertices - eye_m, axis=1).min() > 0.15)


def _apart(first: PlacedObject, second: PlacedObject) -> bool:
    """Whether the feet of two objects keep clear of each other."""
    middles = [
        transformed(item.world_from_object, item.shape.feet_middle_m[None])[0, :2]
        for item in (first, second)
    ]
    reach_m = first.shape.feet_radius_m + second.shape.feet_radius_m
    return bool(np.linalg.norm(middles[0] - middles[1]) > reach_m + CLEARANCE_M)
