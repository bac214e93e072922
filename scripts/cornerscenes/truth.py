"""What is true of a scene: corners, edges and faces, as projected and as seen."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from cornerscenes.camera import inverse, transformed
from cornerscenes.false_junctions import false_junctions
from cornerscenes.film import SeenCorner, floor_px
from cornerscenes.mitsuba_backend import World
from cornerscenes.noise_floor import SeenEdge, sides
from cornerscenes.placement import visible_fraction
from cornerscenes.scene import FIRST_OBJECT_ID, FIRST_SURFACE_ID, TARGET_ID, Scene
from cornerscenes.visibility import Interval, Outlines, Triangles, seen_intervals

# Cells per side of a face, on which its visible fraction is sampled.
FACE_CELLS = 96

# What is near a corner [px], sampled on every pixel's place; how far an occluder matters [px].
NEAR_PX = 10.0
OCCLUDER_WITHIN_PX = 64.0

# An edge counts for a corner's junction when at least this much of it is seen from there [px].
SHORTEST_EDGE_PX = 1.0

# Angles between edges that differ by less than this are the same [deg].
_SAME_DEG = 1e-6


def truth(scene: Scene, world: World) -> dict[str, Any]:
    """Return the content of truth.json, without what only the film can tell.

    Corners are the ideal vertices (intersections of the planes), projected in float64. What is seen
    of corners and edges is decided on every triangle of the scene, in float64; the visible fraction
    of faces by ray casts on a grid.

    Parameters
    ----------
    scene : Scene
        The resolved scene.
    world : World
        The same scene as the renderer holds it.
    """
    return _Truth(scene, world).content()


class _Truth:
    def __init__(self, scene: Scene, world: World) -> None:
        self.scene, self.target, self.wireframe = scene, scene.target, scene.target.wireframe
        self.eye = scene.eye_m
        self.facing = set(scene.target.facing(self.eye))
        self.vertices = scene.target.vertices_m()
        self.image_points = scene.image_of(self.vertices)
        self.triangles = Triangles.of(scene)
        # The target is convex: of the faces that look at the camera it hides nothing itself.
        is_target = self.triangles.object_id == TARGET_ID
        self.itself, self.around = (self.triangles.where(part) for part in (is_target, ~is_target))
        self.before = self.around.between(self.eye, self.vertices)
        ids = self.around.object_id
        self.outlines = Outlines(
            scene.camera,
            scene.world_from_camera,
            self.around.where((ids >= FIRST_OBJECT_ID) & (ids < FIRST_SURFACE_ID)),
            max(self._depth_m(vertex) for vertex in self.vertices),
        )
        self.world = world.without(TARGET_ID)
        self._fractions: dict[int, float] = {}
        self.intervals = [self._edge_intervals(index) for index in range(len(self.wireframe.edges))]

    def content(self) -> dict[str, Any]:
        """Return the content of truth.json."""
        hidden = self.before.hide(self.eye, self.vertices)
        corners = [self._corner(index, bool(hidden[index])) for index in range(len(self.vertices))]
        across = self.image_points[:, None] - self.image_points
        return {
            "corners": corners,
            "edges": [self._edge(index) for index in range(len(self.wireframe.edges))],
            "faces": [self._face(index) for index in range(len(self.wireframe.faces))],
            "false_junctions": false_junctions(
                self.scene,
                self.triangles,
                self.intervals,
                np.array(
                    [c["image_point_px"] for c in corners if c["visibility"] == "visible"]
                ).reshape(-1, 2),
            ),
            "target_visible_fraction": visible_fraction(
                self.target, self.eye, self._hidden_by_others, FACE_CELLS
            ),
            "across_px": float(np.linalg.norm(across, axis=2).max()),
        }

    def _hidden_by_others(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        return self.world.occluded(self.eye, points)

    def _seen(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        on_sensor = self.scene.camera.contains(self.scene.image_of(points))
        return on_sensor & ~self._hidden_by_others(points)

    def _edge_intervals(self, index: int) -> list[Interval]:
        if not self.facing & set(self.wireframe.edge_faces[index]):
            return []
        start, end = self.vertices[list(self.wireframe.edges[index])]
        scene = self.scene
        return seen_intervals(scene.camera, scene.world_from_camera, start, end, self.before)

    def _corner(self, index: int, is_hidden: bool) -> dict[str, Any]:
        position, image_point = self.vertices[index], self.image_points[index]
        faces = self.wireframe.faces_at(index)
        if not self.facing & set(faces):
            visibility = "self-occluded"
        elif not self.scene.camera.contains(image_point[None])[0]:
            visibility = "outside"
        else:
            visibility = "occluded" if is_hidden else "visible"
        edges = [
            self._edge_from(edge, index)
            for edge in self.wireframe.edges_at(index)
            if self.facing & set(self.wireframe.edge_faces[edge])
        ]
        is_visible = visibility == "visible"
        depth_m = self._depth_m(position)
        radius_m = self.target.bevel_radius_m
        return {
            "index": index,
            "position_m": position.tolist(),
            "image_point_px": image_point.tolist(),
            "visibility": visibility,
            "junction": junction(edges, self.target.kind == "board") if is_visible else None,
            "edges": edges,
            "faces": [self._face_at(face, index) for face in faces if face in self.facing],
            "nearest_occluder_px": self._nearest_occluder_px(position) if is_visible else None,
            "bevel_radius_px": radius_m * self.scene.camera.fx_px / depth_m,
            "apex_image_point_px": self._apex_px(index) if radius_m > 0.0 else None,
            "blur_px": self._blur_px(position),
            "render_noise_floor_px": None,
        }

    def _edge_from(self, edge: int, vertex: int) -> dict[str, Any]:
        """Return an edge as it is seen from one of its ends."""
        first, second = self.wireframe.edges[edge]
        starts_here = first == vertex
        along = self.image_points[second if starts_here else first] - self.image_points[vertex]
        length = float(np.linalg.norm(along))
        reach = 0.0  # share of the edge that is seen from the vertex on
        for seen in self.intervals[edge]:
            if starts_here and seen.started_by == "vertex":
                reach = seen.end
            if not starts_here and seen.ended_by == "vertex":
                reach = 1.0 - seen.start
        other = self.vertices[second if starts_here else first]
        place = self.vertices[vertex]
        end_px = self.scene.image_of((place + reach * (other - place))[None])[0]
        return {
            "edge": edge,
            "direction": (along / length).tolist() if length > 0.0 else [1.0, 0.0],
            "length_px": length,
            "visible_length_px": float(np.linalg.norm(end_px - self.image_points[vertex])),
            "contrast": None,
            "blur_px": self._blur_px(place + 0.5 * reach * (other - place)),
        }

    def _depth_m(self, point_m: Float[np.ndarray, "3"]) -> float:
        return float(transformed(inverse(self.scene.world_from_camera), point_m[None])[0, 2])

    def _blur_px(self, point_m: Float[np.ndarray, "3"]) -> float:
        """Return the standard deviation, along any axis, of the disc that a point becomes."""
        if self.scene.lens is None:
            return 0.0
        focal_px = self.scene.camera.fx_px
        return 0.5 * self.scene.lens.blur_radius_px(self._depth_m(point_m), focal_px)

    def _apex_px(self, index: int) -> list[float]:
        """Return the image of the point of a rounded corner that is nearest to the ideal one."""
        normals = np.stack([self.target.normal(face) for face in self.wireframe.faces_at(index)])
        outwards = normals.sum(axis=0)  # to the vertex from the middle of its sphere
        inset = (1.0 - 1.0 / np.linalg.norm(outwards)) * self.target.bevel_radius_m * outwards
        return self.scene.image_of((self.vertices[index] - inset)[None])[0].tolist()

    def _nearest_occluder_px(self, point_m: Float[np.ndarray, "3"]) -> float | None:
        return self.outlines.nearest_px(
            point_m,
            lambda place: not self.itself.hide(self.eye, place[None])[0],
            OCCLUDER_WITHIN_PX,
        )

    def _face_at(self, face: int, vertex: int) -> dict[str, Any]:
        points = self._near_points_m(face, vertex)
        return {
            "face": face,
            "visible_fraction": self._face_fraction(face),
            "near_visible_fraction": float(self._seen(points).mean()) if len(points) else None,
        }

    def _near_points_m(self, face: int, vertex: int) -> Float[np.ndarray, "n 3"]:
        """Return points of a face near a vertex in the image, one for each pixel's place."""
        steps = np.arange(-NEAR_PX, NEAR_PX + 0.5)
        offsets = np.stack([axis.ravel() for axis in np.meshgrid(steps, steps)], axis=1)
        offsets = offsets[np.linalg.norm(offsets, axis=1) <= NEAR_PX]
        rays = self.scene.camera.rays(self.image_points[vertex] + offsets)
        rays = rays @ self.scene.world_from_camera[:3, :3].T
        first, second, _, fourth = self.vertices[list(self.wireframe.faces[face])]
        normal = self.target.normal(face)
        with np.errstate(divide="ignore"):
            distance = normal @ (first - self.eye) / (rays @ normal)
        points = (self.eye + distance[:, None] * rays)[np.isfinite(distance) & (distance > 0.0)]
        axes = np.stack([second - first, fourth - first], axis=1)
        shares = (points - first) @ axes / (axes**2).sum(axis=0)
        return points[((shares > 0.0) & (shares < 1.0)).all(axis=1)]

    def _edge(self, index: int) -> dict[str, Any]:
        intervals = self.intervals[index]
        return {
            "index": index,
            "corners": list(self.wireframe.edges[index]),
            "faces": list(self.wireframe.edge_faces[index]),
            "visible_fraction": sum(seen.end - seen.start for seen in intervals),
            "visible": [asdict(seen) for seen in intervals],
        }

    def _face_fraction(self, face: int) -> float:
        if face not in self._fractions:
            seen = self._seen(self.target.face_points_m(face, FACE_CELLS))
            self._fractions[face] = float(seen.mean())
        return self._fractions[face]

    def _face(self, index: int) -> dict[str, Any]:
        corners = self.vertices[list(self.wireframe.faces[index])]
        centre = corners.mean(axis=0)
        is_facing = index in self.facing
        return {
            "index": index,
            "name": self.wireframe.face_names[index],
            "corners": list(self.wireframe.faces[index]),
            "facing": is_facing,
            "visible_fraction": self._face_fraction(index) if is_facing else 0.0,
            "centre_m": centre.tolist(),
            "centre_image_point_px": self.scene.image_of(centre[None])[0].tolist(),
            "normal": self.target.normal(index).tolist(),
            "extent_m": list(self.target.face_extent_m(index)),
        }


def junction(edges: list[dict[str, Any]], on_board: bool) -> str | None:
    """Return what a visible corner looks like: what the edges that are seen from it make.

    Parameters
    ----------
    edges : list[dict]
        Its edges as truth.json has them.
    on_board : bool
        Whether it is a board's.
    """
    seen = [edge for edge in edges if edge["visible_length_px"] >= SHORTEST_EDGE_PX]
    if len(seen) < 3:
        return (None, "edge end", "L")[len(seen)]
    if on_board and len(seen) == 4:
        return "X"
    angles = np.sort([np.degrees(np.arctan2(*reversed(edge["direction"]))) for edge in seen])
    gaps = np.diff(np.append(angles, angles[0] + 360.0))
    return "Y" if gaps.max() < 180.0 - _SAME_DEG else "arrow"


def seen_corners(content: dict[str, Any]) -> list[SeenCorner]:
    """Return the corners that truth.json's content calls visible, with their edges."""
    return [
        SeenCorner(
            np.array(corner["image_point_px"]),
            tuple(_seen_edge(edge) for edge in corner["edges"] if edge["visible_length_px"] > 0.0),
            corner["blur_px"],
        )
        for corner in content["corners"]
        if corner["visibility"] == "visible"
    ]


def add_from_film(
    content: dict[str, Any],
    pixels: Float[np.ndarray, "h w 3"],
    variance: Float[np.ndarray, "h w 3"],
) -> None:
    """Add to truth.json's content what the film tells of visible corners: contrast, noise floor.

    Parameters
    ----------
    content : dict
        As `truth` returns it.
    pixels, variance : Float[np.ndarray, "h w 3"]
        Radiance and its variance at sensor resolution.
    """
    visible = [corner for corner in content["corners"] if corner["visibility"] == "visible"]
    for corner, seen in zip(visible, seen_corners(content), strict=True):
        for edge in corner["edges"]:
            found = sides(pixels, variance, seen.image_point_px, _seen_edge(edge))
            edge["contrast"] = None if found is None else found.contrast.tolist()
        corner["render_noise_floor_px"] = floor_px(seen, pixels, variance)


def _seen_edge(edge: dict[str, Any]) -> SeenEdge:
    return SeenEdge(np.array(edge["direction"]), edge["visible_length_px"])
