"""Compare what truth.json says of visibility with brute force.

Draws scenes, and asks on 100 000 points of their targets' edges and faces: edges as the intervals
of truth.json have them, faces as its ray casts do. The judge is written without either: every
triangle is projected from the eye onto a plane, put into the bins of a grid, and each point is
tested by the signs of volumes against all triangles of its bin, in float64. Where the two disagree,
the distance to the nearest boundary is measured: along the edge, or on rings about the point on the
face. Prints one JSON line per scene and one for all.

    python studies/visibility.py --recipes ../scenes --suite quick
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from cornerscenes import mitsuba_backend
from cornerscenes.layout import lay_out
from cornerscenes.library import Library
from cornerscenes.mitsuba_backend import World
from cornerscenes.recipes import Family, Suite
from cornerscenes.scene import TARGET_ID, Scene
from cornerscenes.tables import RecipeError, read
from cornerscenes.truth import truth
from cornerscenes.visibility import Triangles

POINTS = 100_000
BINS = 400
RINGS_M = np.geomspace(1e-8, 1e-3, 26)


class Judge:
    """Says of points whether a triangle stands between the eye and them."""

    def __init__(self, eye: np.ndarray, triangles: np.ndarray, about: np.ndarray) -> None:
        """Bin the triangles as seen from the eye about a point."""
        self.triangles = triangles - eye
        self.eye = eye
        forward = (about - eye) / np.linalg.norm(about - eye)
        right = np.cross(forward, [0.3, -0.2, 0.9])
        right /= np.linalg.norm(right)
        self.axes = np.stack([right, np.cross(forward, right), forward])
        corners = self.triangles @ self.axes.T
        # Of a triangle that reaches behind the eye the bins are unknown: it is in all of them.
        behind = corners[..., 2].min(axis=1) < 1e-3
        self.always = np.flatnonzero(behind & (corners[..., 2].max(axis=1) > 0.0))
        rest = np.flatnonzero(~behind)
        flat = corners[rest, :, :2] / corners[rest, :, 2:]
        self.scale = BINS / 2.0
        low = np.floor((flat.min(axis=1) + 1.0) * self.scale).astype(int)
        high = np.floor((flat.max(axis=1) + 1.0) * self.scale).astype(int)
        self.bins: dict[tuple[int, int], list[int]] = {}
        for index, (x0, y0), (x1, y1) in zip(rest, low, high, strict=True):
            for x in range(max(x0, 0), min(x1, BINS - 1) + 1):
                for y in range(max(y0, 0), min(y1, BINS - 1) + 1):
                    self.bins.setdefault((x, y), []).append(int(index))

    def hidden(self, points: np.ndarray) -> np.ndarray:
        """Return of each point whether it is hidden; all lie within 45 degrees of the middle."""
        rays = points - self.eye
        seen_from = rays @ self.axes.T
        bins = np.floor((seen_from[:, :2] / seen_from[:, 2:] + 1.0) * self.scale).astype(int)
        keys = bins[:, 0] * BINS + bins[:, 1]
        found = np.zeros(len(points), dtype=bool)
        order = np.argsort(keys, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(keys[order])) + 1):
            key = (int(bins[group[0], 0]), int(bins[group[0], 1]))
            chosen = np.concatenate([self.always, self.bins.get(key, [])]).astype(int)
            for part in np.array_split(group, max(1, len(group) * len(chosen) // 1_000_000)):
                found[part] = self._meets(rays[part], self.triangles[chosen])
        return found

    def _meets(self, rays: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        a, b, c = (triangles[:, k] for k in range(3))
        hands = [rays @ np.cross(p, q).T for p, q in ((a, b), (b, c), (c, a))]
        through = np.logical_and.reduce([h > 0 for h in hands])
        through |= np.logical_and.reduce([h < 0 for h in hands])
        normal = np.cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.einsum("ij,ij->i", normal, a) / (rays @ normal.T)
        return (through & (share > 0.0) & (share < 1.0 - 1e-7)).any(axis=1)


def check(scene: Scene) -> dict[str, float]:
    """Return how many points disagree, and how far from a boundary the worst one lies [m]."""
    world = World.of(scene, 2)
    content = truth(scene, world)
    around = world.without(TARGET_ID)
    every = Triangles.of(scene)
    vertices, eye = scene.target.vertices_m(), scene.eye_m
    judge = Judge(eye, every.corners_m[every.object_id != TARGET_ID], vertices.mean(axis=0))
    generator = np.random.default_rng(0)
    facing = set(scene.target.facing(eye))
    edges = [e for e in content["edges"] if facing & set(e["faces"])]
    count = POINTS // (len(edges) + len(facing))
    asked = disagree = hidden = 0
    worst = 0.0

    def on_sensor(points: np.ndarray) -> np.ndarray:
        return scene.camera.contains(scene.image_of(points))

    for edge in edges:
        start, end = vertices[edge["corners"]]
        shares = generator.random(count)
        points = start + shares[:, None] * (end - start)
        ends = np.array([[part["start"], part["end"]] for part in edge["visible"]]).reshape(-1, 2)
        said = ((shares[:, None] > ends[:, 0]) & (shares[:, None] < ends[:, 1])).any(axis=1)
        right = on_sensor(points) & ~judge.hidden(points)
        length = np.linalg.norm(end - start)
        for share in shares[said != right]:
            worst = max(worst, float(np.abs(ends - share).min(initial=1.0) * length))
        asked, disagree = asked + count, disagree + int((said != right).sum())
        hidden += int((~right).sum())
    for face in facing:
        a, b, _, d = vertices[list(scene.target.wireframe.faces[face])]
        shares = generator.random((count, 2))
        points = a + shares[:, :1] * (b - a) + shares[:, 1:] * (d - a)
        said, right = around.occluded(eye, points), judge.hidden(points)
        for point in points[said != right]:
            worst = max(worst, _to_boundary_m(judge, point, b - a, d - a))
        asked, disagree = asked + count, disagree + int((said != right).sum())
        hidden += int(right.sum())
    return {
        "points": asked,
        "hidden": hidden,
        "disagree": disagree,
        "worst_m": worst,
        "triangles": len(every.object_id),
    }


def _to_boundary_m(judge: Judge, point: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """Return the radius of the first ring about a point on which the judge changes its mind."""
    angles = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)[:, None]
    ring = np.cos(angles) * one / np.linalg.norm(one) + np.sin(angles) * other / np.linalg.norm(
        other
    )
    itself = judge.hidden(point[None])[0]
    for radius in RINGS_M:
        if (judge.hidden(point + radius * ring) != itself).any():
            return float(radius)
    return float("inf")


def main() -> int:
    """Check every scene of a suite."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--recipes", type=Path, required=True)
    parser.add_argument("--suite", default="quick")
    parser.add_argument("--scenes", type=int, default=None, help="only the first so many")
    arguments = parser.parse_args()
    mitsuba_backend.choose_variant()
    suite = read(Suite, arguments.recipes / "suites" / f"{arguments.suite}.toml")
    library = Library.of(arguments.recipes)
    found = []
    for recipe in suite.all_scenes(arguments.suite)[: arguments.scenes]:
        family = read(Family, arguments.recipes / "families" / f"{recipe.family}.toml")
        try:
            scene = lay_out(arguments.suite, recipe, family, library)
        except RecipeError as error:
            print(json.dumps({"scene": recipe.name, "skipped": str(error)}), flush=True)
            continue
        found.append(check(scene))
        print(json.dumps({"scene": recipe.name, **found[-1]}), flush=True)
    worst = max((one["worst_m"] for one in found), default=float("inf"))
    total = {key: sum(one[key] for one in found) for key in ("points", "hidden", "disagree")}
    print(json.dumps({"scenes": len(found), **total, "worst_m": worst, "allowed_m": 1e-5}))
    return 0 if worst <= 1e-5 else 1


if __name__ == "__main__":
    sys.exit(main())
