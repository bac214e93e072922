"""The target: what carries the true corners, as points, lines and faces and as meshes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from cornerscenes.camera import transformed
from cornerscenes.shape import Part

# The id of a triangle that belongs to no flat face: the fillet of a bevelled edge.
FILLET = 6


@dataclass(frozen=True)
class Wireframe:
    """Corners, edges and faces of a target in its own frame.

    Attributes
    ----------
    vertices_m : Float[np.ndarray, "n 3"]
        The corners [m]: intersections of the ideal planes.
    edges : tuple[tuple[int, int], ...]
        The two vertices of each edge.
    edge_faces : tuple[tuple[int, int], ...]
        The two faces that meet in each edge; twice the same where an edge is drawn on a face.
    faces : tuple[tuple[int, int, int, int], ...]
        The four vertices of each face, counter-clockwise seen from outside.
    face_names : tuple[str, ...]
        A name for each.
    normals : Float[np.ndarray, "k 3"]
        Their outward normals.
    """

    vertices_m: Float[np.ndarray, "n 3"]
    edges: tuple[tuple[int, int], ...]
    edge_faces: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, int, int, int], ...]
    face_names: tuple[str, ...]
    normals: Float[np.ndarray, "k 3"]

    def edges_at(self, vertex: int) -> list[int]:
        """Return the edges that end in a vertex."""
        return [index for index, ends in enumerate(self.edges) if vertex in ends]

    def faces_at(self, vertex: int) -> list[int]:
        """Return the faces that its edges bound, sorted."""
        return sorted({face for edge in self.edges_at(vertex) for face in self.edge_faces[edge]})


@dataclass(frozen=True)
class Target:
    """The target, placed.

    Attributes
    ----------
    kind : {"cuboid", "board"}
        What it is.
    size_m : tuple[float, float, float]
        Extent along its own axes [m].
    wireframe : Wireframe
        Its corners, edges and faces.
    parts : tuple[Part, ...]
        Its meshes.
    world_from_target : Float[np.ndarray, "4 4"]
        Its pose.
    bevel_radius_m : float
        Radius of its rounded edges [m], 0 where they are sharp.
    texture_corners_m : Float[np.ndarray, "k 3"]
        Corners of what is printed on it, in its own frame [m].
    """

    kind: Literal["cuboid", "board"]
    size_m: tuple[float, float, float]
    wireframe: Wireframe
    parts: tuple[Part, ...]
    world_from_target: Float[np.ndarray, "4 4"]
    bevel_radius_m: float
    texture_corners_m: Float[np.ndarray, "k 3"]

    def vertices_m(self) -> Float[np.ndarray, "n 3"]:
        """Return the vertices in the world [m]."""
        return transformed(self.world_from_target, self.wireframe.vertices_m)

    def face_points_m(self, face: int, count: int) -> Float[np.ndarray, "n 3"]:
        """Return a count x count grid of cell centres on a face, in the world [m]."""
        corners = self.vertices_m()[list(self.wireframe.faces[face])]
        steps = (np.arange(count) + 0.5) / count
        along, across = np.meshgrid(steps, steps)
        return (
            corners[0]
            + along.ravel()[:, None] * (corners[1] - corners[0])
            + across.ravel()[:, None] * (corners[3] - corners[0])
        )

    def face_extent_m(self, face: int) -> tuple[float, float]:
        """Return the lengths of a face's first and last side [m]."""
        corners = self.wireframe.vertices_m[list(self.wireframe.faces[face])]
        return (
            float(np.linalg.norm(corners[1] - corners[0])),
            float(np.linalg.norm(corners[3] - corners[0])),
        )

    def normal(self, face: int) -> Float[np.ndarray, "3"]:
        """Return a face's outward normal in the world."""
        return self.world_from_target[:3, :3] @ self.wireframe.normals[face]

    def facing(self, eye_m: Float[np.ndarray, "3"]) -> list[int]:
        """Return the faces whose outside is towards an eye in the world [m]."""
        vertices = self.vertices_m()
        return [
            face
            for face, corners in enumerate(self.wireframe.faces)
            if self.normal(face) @ (eye_m - vertices[corners[0]]) > 0.0
        ]
