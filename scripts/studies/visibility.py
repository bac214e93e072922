"""Whether truth.json says of corners, edges and faces what brute force says they show.

Scenes are drawn from a suite, by default the first ones of every family of `standard`, and each is
asked on 100 000 points of its target: edges and corners as truth.json has them, faces by the ray
casts that their visible fractions are counted with. The judge is written without either: every
triangle is projected from the eye onto a plane and put into the bins of a grid, and each point is
tested by the signs of volumes against all triangles of its bin, in float64. Where the two disagree,
the distance to the nearest boundary is measured: to the next end that truth.json gives an edge's
part, or to the first ring about the point on which the judge changes its mind. Prints one JSON line
per scene and one for all; ends with 1 where one disagreement is farther than 10 micrometres from a
boundary: `python -m studies.visibility`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from cornerscenes import mitsuba_backend
from cornerscenes.layout import lay_out
from cornerscenes.library import Library
from cornerscenes.mitsuba_backend import World
from cornerscenes.recipes import Family, SceneRecipe, Suite
from cornerscenes.scene import TARGET_ID, Scene
from cornerscenes.tables import RecipeError, read
from cornerscenes.truth import truth
from cornerscenes.visibility import Triangles

RECIPES = Path(__file__).parents[2] / "scenes"
POINTS = 100_000
ALLOWED_M = 1e-5

_BINS = 400
_RINGS_M = np.geomspace(1e-8, 1e-3, 26)

# A point lies on its own surface, not behind it.
_BEFORE = 1.0 - 1e-7


def main() -> int:
    """Check the scenes; return 0 if nothing disagrees but at boundaries."""
    parser = argparse.ArgumentParser(prog="studies.visibility", description=__doc__)
    parser.add_argument("--suite", default="standard", help="where the scenes are drawn from")
    parser.add_argument("--each", type=int, default=2, help="scenes of each family")
    arguments = parser.parse_args()
    mitsuba_backend.choose_variant()
    total: Counter[str] = Counter()
    for recipe, scene in _drawn(arguments.suite, arguments.each):
        world = World.of(scene, 2)
        found = disagreements(scene, world, truth(scene, world), POINTS)
        print(json.dumps({"scene": recipe.name, **found}), flush=True)
        total.update({key: value for key, value in found.items() if key != "worst_m"})
        total["scenes"] += 1
    print(json.dumps({**total, "allowed_m": ALLOWED_M}))
    return 1 if total["far"] or not total["hidden"] else 0


def _drawn(name: str, each: int) -> Iterator[tuple[SceneRecipe, Scene]]:
    """Draw the first scenes of each family of a suite."""
    suite = read(Suite, RECIPES / "suites" / f"{name}.toml")
    library = Library.of(RECIPES)
    drawn: Counter[str] = Counter()
    for recipe in suite.all_scenes(name):
        if drawn[recipe.family] == each:
            continue
        family = read(Family, RECIPES / "families" / f"{recipe.family}.toml")
        try:
            scene = lay_out(name, recipe, family, library)
        except RecipeError as error:
            print(f"{recipe.name} left out: {error}", file=sys.stderr)
            continue
        drawn[recipe.family] += 1
        yield recipe, scene


class Judge:
    """Says of points whether a triangle stands between an eye and them.

    Parameters
    ----------
    eye : Float[np.ndarray, "3"]
        The eye in the world [m].
    triangles : Float[np.ndarray, "m 3 3"]
        Corners of the triangles in the world [m].
    about : Float[np.ndarray, "3"]
        Points are asked for within 45 degrees of its direction.
    """

    def __init__(
        self,
        eye: Float[np.ndarray, "3"],
        triangles: Float[np.ndarray, "m 3 3"],
        about: Float[np.ndarray, "3"],
    ) -> None:
        self._eye, self._triangles = eye, triangles - eye
        forward = (about - eye) / np.linalg.norm(about - eye)
        right = np.cross(forward, [0.3, -0.2, 0.9])
        right /= np.linalg.norm(right)
        self._axes = np.stack([right, np.cross(forward, right), forward])
        corners = self._triangles @ self._axes.T
        # Of a triangle that reaches behind the eye the bins are unknown: it is in all of them.
        behind = corners[..., 2].min(axis=1) < 1e-3
        self._always = np.flatnonzero(behind & (corners[..., 2].max(axis=1) > 0.0)).tolist()
        rest = np.flatnonzero(~behind)
        flat = corners[rest, :, :2] / corners[rest, :, 2:]
        low, high = self._bin(flat.min(axis=1)), self._bin(flat.max(axis=1))
        self._bins: dict[tuple[int, int], list[int]] = {}
        for index, (x0, y0), (x1, y1) in zip(rest, low, high, strict=True):
            for x in range(max(x0, 0), min(x1, _BINS - 1) + 1):
                for y in range(max(y0, 0), min(y1, _BINS - 1) + 1):
                    self._bins.setdefault((x, y), []).append(int(index))

    def hides(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Return of each point in the world [m] whether it is hidden."""
        rays = points - self._eye
        found = np.zeros(len(points), dtype=bool)
        if not len(points):
            return found
        seen = rays @ self._axes.T
        bins = self._bin(seen[:, :2] / seen[:, 2:])
        keys = bins[:, 0] * _BINS + bins[:, 1]
        order = np.argsort(keys, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(keys[order])) + 1):
            key = int(bins[group[0], 0]), int(bins[group[0], 1])
            chosen = np.array(self._always + self._bins.get(key, []), dtype=int)
            for part in np.array_split(group, max(1, len(group) * len(chosen) // 1_000_000)):
                found[part] = _meets(rays[part], self._triangles[chosen])
        return found

    def to_boundary_m(
        self,
        point: Float[np.ndarray, "3"],
        one: Float[np.ndarray, "3"],
        other: Float[np.ndarray, "3"],
    ) -> float:
        """Return the radius of the first ring about a point on which the answer changes [m].

        Parameters
        ----------
        point : Float[np.ndarray, "3"]
            The point in the world [m].
        one, other : Float[np.ndarray, "3"]
            Two directions in the rings' plane.
        """
        angles = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)[:, None]
        units = [axis / np.linalg.norm(axis) for axis in (one, other)]
        ring = np.cos(angles) * units[0] + np.sin(angles) * units[1]
        itself = self.hides(point[None])[0]
        for radius in _RINGS_M:
            if (self.hides(point + radius * ring) != itself).any():
                return float(radius)
        return float("inf")

    @staticmethod
    def _bin(place: Float[np.ndarray, "n 2"]) -> np.ndarray:
        return np.floor((np.clip(place, -2.0, 2.0) + 1.0) * (_BINS / 2.0)).astype(int)


def _meets(
    rays: Float[np.ndarray, "n 3"], triangles: Float[np.ndarray, "m 3 3"]
) -> Bool[np.ndarray, " n"]:
    """Return which segments from the origin cross a triangle before their end.

    Such a segment crosses the triangle's plane, and passes each of its sides on the same hand.
    """
    a, b, c = (triangles[:, k] for k in range(3))
    hands = [rays @ np.cross(p, q).T for p, q in ((a, b), (b, c), (c, a))]
    through = np.logical_and.reduce([hand > 0 for hand in hands])
    through |= np.logical_and.reduce([hand < 0 for hand in hands])
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.einsum("ij,ij->i", normal, a) / (rays @ normal.T)
    return (through & (share > 0.0) & (share < _BEFORE)).any(axis=1)


def disagreements(
    scene: Scene, world: World, content: dict[str, Any], points: int
) -> dict[str, float]:
    """Return how many points were asked for, are hidden, disagree, and do so far from boundaries.

    Parameters
    ----------
    scene : Scene
        The scene.
    world : World
        The same scene as the renderer holds it.
    content : dict
        Its truth.json.
    points : int
        How many points are asked for, about; the corners come in addition.
    """
    every, vertices, eye = Triangles.of(scene), scene.target.vertices_m(), scene.eye_m
    around = every.corners_m[every.object_id != TARGET_ID]
    judge = Judge(eye, around, vertices.mean(axis=0))
    rays = world.without(TARGET_ID)
    facing = set(scene.target.facing(eye))
    edges = [edge for edge in content["edges"] if facing & set(edge["faces"])]
    count = points // (len(edges) + len(facing))
    generator = np.random.default_rng(0)
    found = Counter(points=0, hidden=0, disagree=0, far=0)
    distances: list[float] = []

    def compare(said: np.ndarray, right: np.ndarray) -> np.ndarray:
        found.update(points=len(said), hidden=int((~right).sum()))
        return np.flatnonzero(said != right)

    def seen(places: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        return scene.camera.contains(scene.image_of(places)) & ~judge.hides(places)

    looking = [
        c for c in content["corners"] if facing & set(scene.target.wireframe.faces_at(c["index"]))
    ]
    places = vertices[[corner["index"] for corner in looking]]
    said = np.array([corner["visibility"] == "visible" for corner in looking])
    for index in compare(said, seen(places)):
        towards = places[index] - eye
        across = np.cross(towards, [0.3, -0.2, 0.9])
        distances.append(judge.to_boundary_m(places[index], across, np.cross(towards, across)))
    for edge in edges:
        start, end = vertices[edge["corners"]]
        shares = generator.random(count)
        parts = np.array([[p["start"], p["end"]] for p in edge["visible"]]).reshape(-1, 2)
        said = np.any((shares[:, None] > parts[:, 0]) & (shares[:, None] < parts[:, 1]), axis=1)
        for index in compare(said, seen(start + shares[:, None] * (end - start))):
            away = np.abs(parts - shares[index]).min(initial=1.0)
            distances.append(float(away * np.linalg.norm(end - start)))
    for face in facing:
        a, b, _, d = vertices[list(scene.target.wireframe.faces[face])]
        shares = generator.random((count, 2))
        places = a + shares[:, :1] * (b - a) + shares[:, 1:] * (d - a)
        for index in compare(~rays.occluded(eye, places), ~judge.hides(places)):
            distances.append(judge.to_boundary_m(places[index], b - a, d - a))
    far = sum(distance > ALLOWED_M for distance in distances)
    found.update(disagree=len(distances), far=far)
    return {**found, "worst_m": max(distances, default=0.0)}


if __name__ == "__main__":
    sys.exit(main())
