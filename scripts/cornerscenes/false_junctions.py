"""False junctions: image points that look like corners of the target and are none, with the cause.

They come from the scene's geometry, never from its image: where an object begins or ends to hide
an edge of the target or a line of the room, where the target's shadow has a corner, and where
something else is known to have one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from cornerscenes import cuboid
from cornerscenes.camera import transformed
from cornerscenes.light import Lamp
from cornerscenes.scene import FIRST_OBJECT_ID, FIRST_SURFACE_ID, TARGET_ID, Scene
from cornerscenes.visibility import Interval, Triangles, seen_intervals

# A false junction nearer than this to a visible true corner is not one of its own [px].
APART_PX = 0.5

# A shadow begins at least this far behind what casts it [m]: nearer it is contact.
_CONTACT_M = 1e-6

# How far off parallel light is taken to come from [m].
_SUN_M = 100.0


def false_junctions(
    scene: Scene,
    triangles: Triangles,
    edges: list[list[Interval]],
    corners_px: Float[np.ndarray, "k 2"],
) -> list[dict[str, Any]]:
    """Return the false junctions that are in the frame and that nothing hides.

    Parameters
    ----------
    scene : Scene
        The scene.
    triangles : Triangles
        All of its.
    edges : list[list[Interval]]
        What is seen of each edge of the target.
    corners_px : Float[np.ndarray, "k 2"]
        The visible true corners.
    """
    found = _at_edges(scene, edges) + _at_lines(scene, triangles)
    candidates = _known(scene)
    for index, lamp in enumerate(scene.light.lamps):
        if lamp.is_sharp:
            candidates += _Shadow(scene, triangles, lamp, f"lamp {index}").junctions()
    points = np.array([one["position_m"] for one in candidates]).reshape(-1, 3)
    depths = (points - scene.eye_m) @ scene.world_from_camera[:3, 2]
    for one, depth in zip(candidates, depths, strict=True):
        point = np.array(one["position_m"])[None]
        if depth > 0.0 and scene.camera.contains(scene.image_of(point))[0]:
            if not triangles.hide(scene.eye_m, point)[0]:
                found.append(one)
    for one in found:
        one["image_point_px"] = scene.image_of(np.array(one["position_m"])[None])[0].tolist()
    return [
        one
        for one in found
        if not (np.linalg.norm(corners_px - one["image_point_px"], axis=1) < APART_PX).any()
    ]


def _junction(
    cause: str,
    name: str,
    position_m: Float[np.ndarray, "3"],
    object_id: int | None = None,
    edge: int | None = None,
) -> dict[str, Any]:
    return {
        "cause": cause,
        "name": name,
        "position_m": position_m.tolist(),
        "object_id": object_id,
        "edge": edge,
    }


def _at_edges(scene: Scene, edges: list[list[Interval]]) -> list[dict[str, Any]]:
    """Return where objects begin or end to hide an edge of the target."""
    vertices = scene.target.vertices_m()
    return [
        _junction("T", _name(scene, number), point, number, index)
        for index, (first, second) in enumerate(scene.target.wireframe.edges)
        for number, point in _hidden_ends(edges[index], vertices[first], vertices[second])
    ]


def _at_lines(scene: Scene, triangles: Triangles) -> list[dict[str, Any]]:
    """Return where target or objects begin or end to hide a line of the room."""
    found = []
    for line in scene.lines:
        start, end = line.start_m, line.end_m
        seen = seen_intervals(scene.camera, scene.world_from_camera, start, end, triangles)
        found += [
            _junction("T", line.name, point, number)
            for number, point in _hidden_ends(seen, start, end)
        ]
    return found


def _hidden_ends(
    seen: list[Interval], start_m: Float[np.ndarray, "3"], end_m: Float[np.ndarray, "3"]
) -> list[tuple[int, Float[np.ndarray, "3"]]]:
    """Return the ends [m] of intervals of a line that an object makes, with its id."""
    return [
        (by, start_m + share * (end_m - start_m))
        for one in seen
        for share, by in ((one.start, one.started_by), (one.end, one.ended_by))
        if isinstance(by, int)
    ]


def _name(scene: Scene, object_id: int) -> str:
    if object_id == TARGET_ID:
        return "target"
    if object_id >= FIRST_SURFACE_ID:
        return scene.surfaces[object_id - FIRST_SURFACE_ID].name
    return next(item.builder for item in scene.objects if item.object_id == object_id)


def _known(scene: Scene) -> list[dict[str, Any]]:
    return [
        _junction(known.cause, known.name, point)
        for known in scene.known_corners()
        for point in known.points_m
    ]


class _Shadow:
    """The corners of the target's shadow in the light of one lamp whose shadows are sharp."""

    def __init__(self, scene: Scene, triangles: Triangles, lamp: Lamp, name: str) -> None:
        self.scene, self.lamp, self.name = scene, lamp, name
        self.others = triangles.where(triangles.object_id != TARGET_ID)
        target = scene.target
        # Of a board it is its body's: both fill the box of their size.
        self.vertices = transformed(target.world_from_target, cuboid.vertices(target.size_m))
        normals = cuboid.NORMALS @ target.world_from_target[:3, :3].T
        self.is_lit = [
            bool(normals[face] @ self._ray(self.vertices[corners[0]]) < 0.0)
            for face, corners in enumerate(cuboid.FACES)
        ]
        self.outline = [
            edge
            for edge in cuboid.EDGES
            if self.is_lit[cuboid.faces_of_edge(edge)[0]]
            != self.is_lit[cuboid.faces_of_edge(edge)[1]]
        ]

    def junctions(self) -> list[dict[str, Any]]:
        """Return the shadow's corners, seen from the camera or not."""
        return self._of_vertices() + self._at_lines()

    def _ray(self, point_m: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Return the direction in which light passes a point."""
        if self.lamp.kind == "point":
            return point_m - np.array(self.lamp.position_m)
        towards = np.array(self.lamp.aim_m) - np.array(self.lamp.position_m)
        return towards / np.linalg.norm(towards)

    def _reaches(self, point_m: Float[np.ndarray, "3"]) -> bool:
        """Return whether the lamp shines on a point past everything but the target."""
        ray = self._ray(point_m)
        origin = point_m - ray * (1.0 if self.lamp.kind == "point" else _SUN_M)
        return not self.others.hide(origin, point_m[None])[0]

    def _of_vertices(self) -> list[dict[str, Any]]:
        """Return where the shadows of the vertices fall."""
        found = []
        for index in sorted({vertex for edge in self.outline for vertex in edge}):
            vertex = self.vertices[index]
            ray = self._ray(vertex)
            met = self.others.first_met(vertex, ray, _CONTACT_M / float(np.linalg.norm(ray)))
            if met is None or not self._reaches(vertex):
                continue
            point, triangle = met
            a, b, c = self.others.corners_m[triangle]
            normal = np.cross(b - a, c - a)
            # A sheet that is lit from behind shows no shadow.
            if (normal @ ray > 0.0) == (normal @ (point - self.scene.eye_m) > 0.0):
                number = int(self.others.object_id[triangle])
                name = f"vertex {index} on {_name(self.scene, number)}, {self.name}"
                on_object = FIRST_OBJECT_ID <= number < FIRST_SURFACE_ID
                found.append(_junction("shadow", name, point, number if on_object else None))
        return found

    def _at_lines(self) -> list[dict[str, Any]]:
        """Return where the shadow's outline crosses a line of the room and is bent."""
        found = []
        for edge in self.outline:
            first, second = self.vertices[list(edge)]
            for line in self.scene.lines:
                point = self._on_line(first, second, line.start_m, line.end_m)
                if point is not None and self._reaches(point):
                    found.append(_junction("shadow", f"{line.name}, {self.name}", point))
        return found

    def _on_line(
        self,
        first: Float[np.ndarray, "3"],
        second: Float[np.ndarray, "3"],
        start: Float[np.ndarray, "3"],
        end: Float[np.ndarray, "3"],
    ) -> Float[np.ndarray, "3"] | None:
        """Return where the shadow of an edge meets a line [m]; `None` where it does not."""
        normal = np.cross(second - first, self._ray(first))
        across = normal @ (end - start)
        if abs(across) < 1e-12 * np.linalg.norm(normal) * np.linalg.norm(end - start):
            return None
        share = normal @ (first - start) / across
        if not 0.0 <= share <= 1.0:
            return None
        point = start + share * (end - start)
        # Back along the light to the edge: point - behind * ray = first + place * (second - first).
        ray = self._ray(point)
        (place, behind), *_ = np.linalg.lstsq(
            np.stack([second - first, ray], axis=1), point - first, rcond=None
        )
        is_past = 0.0 < place < 1.0 and behind * np.linalg.norm(ray) > _CONTACT_M
        # Of a lamp's light the part beyond it does not count.
        return point if is_past and (self.lamp.kind == "sun" or behind < 1.0) else None
