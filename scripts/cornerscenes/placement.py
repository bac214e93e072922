"""Placing objects about the target until as much of it is seen as is wanted.

Every object gets a number of places of its own, within what its role allows; from each, what it
hides of the target is cast once. Combinations of places that stand clear of each other are drawn;
the one whose visible fraction comes nearest to its bounds is kept, and its objects are shifted at
random, by less and less, as long as that brings it nearer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from cornerscenes.camera import inverse, standing, transformed
from cornerscenes.mitsuba_backend import Occluder
from cornerscenes.scene import PlacedObject
from cornerscenes.streams import stream
from cornerscenes.tables import RecipeError
from cornerscenes.target import Target

# Places of each object and positions tried for one of them; how often all is begun anew, and the
# combinations drawn and shifts tried each time.
PLACES = 32
TRIES = 40
STARTS = 6
COMBINATIONS = 200
SHIFTS = 150

# Cells per side of a face from which a placement's visible fraction is estimated.
PLACEMENT_CELLS = 24

# Objects keep this distance from the target, the walls and each other's feet.
CLEARANCE_M = 0.012

# Bearing from the target [rad] and distance [m] of each role: an occluder stands about the line to
# the camera, a distractor to one side of it, a bystander anywhere in the room.
_PLACES = {
    "occluder": ((-1.2, 1.2), (0.13, 0.50)),
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
    if not built:
        return ()
    ground = _Ground(target, eye_m, walls_m, wanted)
    # The broadest first: what is narrow still finds a gap.
    order = sorted(built, key=lambda item: -item.shape.feet_radius_m)
    pools = [_places(key, item, ground) for item in order]
    nearest: list[_Spot] = []
    for start in range(STARTS):
        generator = stream(key, "combination", start)
        best = _best_combination(generator, pools, ground)
        for step in range(SHIFTS if best else 0):
            if ground.distance(best) == 0.0:
                return tuple(sorted((s.item for s in best), key=lambda item: item.object_id))
            shifted = _shifted(generator, best, 0.10 * 0.97**step, ground)
            if shifted and ground.distance(shifted) < ground.distance(best):
                best = shifted
        if best and (not nearest or ground.distance(best) < ground.distance(nearest)):
            nearest = best
    if not nearest:
        raise RecipeError(
            f"{', '.join(item.builder for item in built)} do not fit about the target in "
            f"{STARTS * COMBINATIONS} placements; make them smaller or fewer"
        )
    low, high = wanted or (0.0, 1.0)
    raise RecipeError(
        f"visible_fraction [{low:.3f}, {high:.3f}] not met by {STARTS * COMBINATIONS} placements "
        f"and {STARTS * SHIFTS} shifts, nearest {ground.fraction(nearest):.3f}; widen the range or "
        "move the family's occluders"
    )


@dataclass(frozen=True)
class _Spot:
    """An object in a place, and which of the target's cells it hides there."""

    item: PlacedObject
    hides: Bool[np.ndarray, " n"]


class _Ground:
    """What objects are placed about: target, camera, walls, and how much is to be seen."""

    def __init__(
        self,
        target: Target,
        eye_m: Float[np.ndarray, "3"],
        walls_m: Float[np.ndarray, "2"],
        wanted: tuple[float, float] | None,
    ) -> None:
        self.target, self.eye_m, self.walls_m = target, eye_m, walls_m
        self._wanted = wanted
        self._cells_m, self._weights = _facing_points(target, eye_m, PLACEMENT_CELLS)
        self._occluders: dict[int, Occluder] = {}

    def spot(self, item: PlacedObject) -> _Spot | None:
        """Return an object in its place, or `None` where it does not stand clear."""
        if not _fits(item, self.target, self.eye_m, self.walls_m):
            return None
        if self._wanted is None:
            return _Spot(item, np.zeros(len(self._cells_m), dtype=bool))
        number = item.object_id
        if number not in self._occluders:
            self._occluders[number] = Occluder(item.shape.parts)
        occluder = self._occluders[number]
        return _Spot(item, occluder.hides(item.world_from_object, self.eye_m, self._cells_m))

    def fraction(self, spots: list[_Spot]) -> float:
        """Return the visible fraction."""
        hidden = np.logical_or.reduce([spot.hides for spot in spots])
        return float(self._weights[~hidden].sum() / self._weights.sum())

    def distance(self, spots: list[_Spot]) -> float:
        """Return how far the visible fraction is from its bounds; 0 within them."""
        if self._wanted is None:
            return 0.0
        low, high = self._wanted
        fraction = self.fraction(spots)
        return max(low - fraction, fraction - high, 0.0)


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


def _places(key: str, item: PlacedObject, ground: _Ground) -> list[_Spot]:
    """Return an object in several places, each clear of target, walls and camera."""
    centre = ground.target.world_from_target[:2, 3]
    towards_eye = _bearing(ground.eye_m[:2] - centre)
    in_room = np.isfinite(ground.walls_m).all()
    towards_room = _bearing(centre - ground.walls_m) if in_room else towards_eye
    bearings, distances = _PLACES[item.role]
    generator = stream(key, item.object_id)
    found: list[_Spot] = []
    for _ in range(TRIES * PLACES):
        angle = generator.uniform(*bearings)
        if item.role == "distractor":
            angle *= generator.choice([-1.0, 1.0])
        angle += towards_room if item.role == "bystander" else towards_eye
        x, y = centre + generator.uniform(*distances) * np.array([np.cos(angle), np.sin(angle)])
        pose = standing(float(x), float(y), float(generator.uniform(-np.pi, np.pi)))
        spot = ground.spot(replace(item, world_from_object=pose))
        if spot is not None:
            found.append(spot)
            if len(found) == PLACES:
                break
    if not found:
        raise RecipeError(
            f"{item.builder} of {item.height_m:.2f} m fits nowhere about the target in "
            f"{TRIES * PLACES} tries; make it smaller or the room larger"
        )
    return found


def _best_combination(
    generator: np.random.Generator, pools: list[list[_Spot]], ground: _Ground
) -> list[_Spot]:
    """Return the best of some combinations of places, empty where none is clear of itself."""
    best: list[_Spot] = []
    for _ in range(COMBINATIONS):
        drawn = _combination(generator, pools)
        if drawn and (not best or ground.distance(drawn) < ground.distance(best)):
            best = drawn
        if best and ground.distance(best) == 0.0:
            break
    return best


def _combination(generator: np.random.Generator, pools: list[list[_Spot]]) -> list[_Spot]:
    """Draw a place of every object, clear of those before it; empty where there is none."""
    drawn: list[_Spot] = []
    for pool in pools:
        free = [spot for spot in pool if all(_apart(spot.item, other.item) for other in drawn)]
        if not free:
            return []
        drawn.append(free[int(generator.integers(len(free)))])
    return drawn


def _shifted(
    generator: np.random.Generator, spots: list[_Spot], reach_m: float, ground: _Ground
) -> list[_Spot] | None:
    """Shift and turn one of the objects; `None` where it does not stand clear then."""
    index = int(generator.integers(len(spots)))
    pose = spots[index].item.world_from_object
    turned = pose @ standing(0.0, 0.0, float(generator.normal(0.0, 4.0 * reach_m)))
    turned[:2, 3] += generator.normal(0.0, reach_m, 2)
    item = replace(spots[index].item, world_from_object=turned)
    others = spots[:index] + spots[index + 1 :]
    if not all(_apart(item, other.item) for other in others):
        return None
    spot = ground.spot(item)
    return None if spot is None else [*others, spot]


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
    (ax, ay), (bx, by) = first.feet_m, second.feet_m
    reach_m = first.shape.feet_radius_m + second.shape.feet_radius_m
    return (ax - bx) ** 2 + (ay - by) ** 2 > (reach_m + CLEARANCE_M) ** 2
