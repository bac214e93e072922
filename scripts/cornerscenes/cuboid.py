"""The cuboid: vertices, faces and edges, numbered once for renderer and truth, and its meshes.

Vertex i has the sign of bit 0 of i along x, of bit 1 along y, of bit 2 along z; the cuboid stands
on z = 0 of its own frame, its axis the z axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from cornerscenes.shape import Material, Part, Texture
from cornerscenes.target import FILLET, Wireframe

FACE_NAMES = ("x-", "x+", "y-", "y+", "z-", "z+")

# Vertices of each face, counter-clockwise seen from outside.
FACES: tuple[tuple[int, int, int, int], ...] = (
    (0, 4, 6, 2),
    (1, 3, 7, 5),
    (0, 1, 5, 4),
    (2, 6, 7, 3),
    (0, 2, 3, 1),
    (4, 5, 7, 6),
)

NORMALS = np.array(
    [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=np.float64
)

# Pairs of vertices that differ in one coordinate.
EDGES = tuple((a, a | 1 << axis) for axis in range(3) for a in range(8) if not a & 1 << axis)

# Chords per quarter turn of a bevelled edge: the outline is inside the true one by at most
# 3e-4 of the radius, 0.001 px where the radius is 4 px.
_CHORDS = 32


def faces_of_edge(edge: tuple[int, int]) -> tuple[int, int]:
    """Return the two faces that meet in an edge."""
    first, second = (face for face, corners in enumerate(FACES) if set(edge) <= set(corners))
    return first, second


def vertices(size_m: tuple[float, float, float]) -> Float[np.ndarray, "8 3"]:
    """Return the eight vertices [m] in the cuboid's frame."""
    bits = np.array([[index >> axis & 1 for axis in range(3)] for index in range(8)])
    return (bits - [0.5, 0.5, 0.0]) * size_m


def wireframe(size_m: tuple[float, float, float]) -> Wireframe:
    """Return corners, edges and faces."""
    return Wireframe(
        vertices_m=vertices(size_m),
        edges=EDGES,
        edge_faces=tuple(faces_of_edge(edge) for edge in EDGES),
        faces=FACES,
        face_names=FACE_NAMES,
        normals=NORMALS,
    )


def sharp(
    size_m: tuple[float, float, float],
    material: Material,
    textures: Mapping[int, Texture] | None = None,
) -> tuple[Part, ...]:
    """Return one mesh per face: two triangles each, with texture coordinates.

    Parameters
    ----------
    size_m : tuple[float, float, float]
        Dimensions [m].
    material : Material
        Of all faces.
    textures : Mapping[int, Texture], optional
        What is printed on a face instead of the material's colour; rows run along the face's last
        side, columns along its first.
    """
    points = vertices(size_m)
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    parts = []
    for face, corners in enumerate(FACES):
        texture = (textures or {}).get(face)
        own = material if texture is None else _printed(material, texture)
        parts.append(
            Part(
                f"face {FACE_NAMES[face]}",
                points[list(corners)],
                np.array([[0, 1, 2], [0, 2, 3]]),
                own,
                smooth=False,
                uv=uv,
                face=face,
            )
        )
    return tuple(parts)


def bevelled(
    size_m: tuple[float, float, float], radius_m: float, material: Material
) -> tuple[Part, ...]:
    """Return the cuboid with all edges rounded: faces, quarter cylinders, eighths of spheres.

    The shading normals are those of the rounded body, not of its triangles.
    """
    steps = np.arange(_CHORDS + 1)
    grid = np.array([[i, j, _CHORDS - i - j] for i in steps for j in steps[: _CHORDS + 1 - i]])
    # Sines, so that the angles along the sides of the eighth, where two of them meet, are equal.
    eighth = np.sin(0.5 * np.pi * grid / _CHORDS)
    eighth /= np.linalg.norm(eighth, axis=1, keepdims=True)
    ideal = vertices(size_m)
    signs = np.where(np.array([[i >> axis & 1 for axis in range(3)] for i in range(8)]), 1.0, -1.0)
    normals = (signs[:, None, :] * eighth).reshape(-1, 3)
    centres = np.repeat(ideal - radius_m * signs, len(eighth), axis=0)
    points = centres + radius_m * normals
    hull = ConvexHull(points, qhull_options="Qt")
    triangles = hull.simplices
    a, b, c = (points[triangles[:, k]] for k in range(3))
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    flat = (normals[triangles] @ NORMALS.T > 1.0 - 1e-12).all(axis=1)  # (triangle, face)
    face = np.where(flat.any(axis=1), flat.argmax(axis=1), FILLET)
    names = (*(f"face {name}" for name in FACE_NAMES), "fillet")
    return tuple(
        Part(name, points, triangles[face == index], material, normals=normals, face=index)
        for index, name in enumerate(names)
    )


def _printed(material: Material, texture: Texture) -> Material:
    return Material(
        material.colour, material.roughness, texture=texture, metallic=material.metallic
    )
