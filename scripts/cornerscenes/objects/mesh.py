"""Bare triangle meshes: joining, moving, creasing, splitting by a field, and finishing to size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..shape import Material, Part

# Triangles below this area [m^2] carry no light and upset normal computation: they are dropped.
SMALLEST_AREA_M2 = 4e-12


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh without a material.

    Attributes
    ----------
    vertices : Float[np.ndarray, "n 3"]
        Positions, in any unit of length.
    triangles : Int[np.ndarray, "m 3"]
        Vertex indices, counter-clockwise seen from outside.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]

    def moved(
        self,
        shift: Sequence[float] | Float[np.ndarray, " 3"] = (0.0, 0.0, 0.0),
        turn: Float[np.ndarray, "3 3"] | None = None,
    ) -> Mesh:
        """Return the mesh turned about the origin and then shifted.

        Parameters
        ----------
        shift : sequence of 3 floats
            Shift, in the unit of the vertices.
        turn : Float[np.ndarray, "3 3"] or None
            Rotation matrix acting on column vectors, `None` for no rotation.

        Returns
        -------
        Mesh
            The moved copy.
        """
        vertices = self.vertices if turn is None else self.vertices @ turn.T
        return Mesh(vertices + np.asarray(shift, float), self.triangles)


def merged(meshes: Iterable[Mesh]) -> Mesh:
    """Put meshes side by side in one mesh, without welding them.

    Parameters
    ----------
    meshes : iterable of Mesh
        The meshes, at least one.

    Returns
    -------
    Mesh
        All their triangles.
    """
    pieces = list(meshes)
    starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces[:-1]])
    return Mesh(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([p.triangles + s for p, s in zip(pieces, starts, strict=True)]),
    )


def compact(mesh: Mesh) -> Mesh:
    """Drop the vertices no triangle uses.

    Parameters
    ----------
    mesh : Mesh
        Any mesh.

    Returns
    -------
    Mesh
        The same surface with renumbered vertices.
    """
    used, numbers = np.unique(mesh.triangles, return_inverse=True)
    return Mesh(mesh.vertices[used], numbers.reshape(-1, 3))


def areas(mesh: Mesh) -> Float[np.ndarray, " m"]:
    """Measure each triangle.

    Parameters
    ----------
    mesh : Mesh
        Any mesh.

    Returns
    -------
    Float[np.ndarray, " m"]
        Areas, in the square of the unit of the vertices.
    """
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def creased(mesh: Mesh, angle_deg: float = 40.0) -> Mesh:
    """Split vertices along sharp edges, so that smooth shading stops there.

    Parameters
    ----------
    mesh : Mesh
        A mesh with shared vertices.
    angle_deg : float
        Edges whose two faces turn by more than this [degrees] become creases.

    Returns
    -------
    Mesh
        The same triangles; a vertex is doubled wherever creases separate the faces around it.
    """
    triangles = mesh.triangles
    count = len(triangles)
    a, b, c = (mesh.vertices[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-300
    # A half edge k of triangle t runs from corner k to corner k + 1; its twin runs backwards.
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low.astype(np.int64) * len(mesh.vertices) + high
    order = np.argsort(key, kind="stable")
    twins = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, two = order[twins], order[twins + 1]
    gentle = np.sum(normals[one // 3] * normals[two // 3], axis=1) > np.cos(np.radians(angle_deg))
    one, two = one[gentle], two[gentle]

    def following(half: Int[np.ndarray, " h"]) -> Int[np.ndarray, " h"]:
        return half // 3 * 3 + (half + 1) % 3

    # Twins run in opposite directions: the start of one is the same vertex as the end of the other.
    same = start[one] == end[two]
    rows = np.concatenate([one, following(one)])
    columns = np.concatenate(
        [np.where(same, following(two), two), np.where(same, two, following(two))]
    )
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(3 * count, 3 * count))
    _, label = connected_components(graph, directed=False)
    _, first, numbers = np.unique(label, return_index=True, return_inverse=True)
    return Mesh(mesh.vertices[start[first]], numbers.reshape(-1, 3))


def split_by_field(mesh: Mesh, field: Float[np.ndarray, " n"]) -> tuple[Mesh, Mesh]:
    """Cut a mesh in two along the zero line of a field on its vertices.

    Parameters
    ----------
    mesh : Mesh
        The mesh to cut.
    field : Float[np.ndarray, " n"]
        A value for each vertex.

    Returns
    -------
    tuple of Mesh
        The part where the field is positive and the part where it is not; either may be empty.
    """
    positive = field > 0
    triangles = mesh.triangles
    count = positive[triangles].sum(axis=1)
    mixed = (count == 1) | (count == 2)
    # Turn each mixed triangle so that its odd corner, alone on its side, comes first.
    odd_sign = count[mixed] == 1
    cut = triangles[mixed]
    odd = np.argmax(positive[cut] == odd_sign[:, None], axis=1)
    cut = np.take_along_axis(cut, (odd[:, None] + np.arange(3)) % 3, axis=1)
    edges = np.sort(np.concatenate([cut[:, [0, 1]], cut[:, [0, 2]]]), axis=1)
    unique, place = np.unique(edges, axis=0, return_inverse=True)
    f0, f1 = field[unique[:, 0]], field[unique[:, 1]]
    # Keeping away from the ends of an edge leaves no sliver, at the price of a slightly bent line.
    part = np.clip(f0 / np.where(f0 == f1, 1.0, f0 - f1), 0.12, 0.88)[:, None]
    ends = mesh.vertices[unique]
    vertices = np.concatenate([mesh.vertices, ends[:, 0] * (1 - part) + ends[:, 1] * part])
    place = place.reshape(2, -1) + len(mesh.vertices)
    tip = np.stack([cut[:, 0], place[0], place[1]], axis=1)
    base = np.concatenate(
        [
            np.stack([place[0], cut[:, 1], cut[:, 2]], axis=1),
            np.stack([place[0], cut[:, 2], place[1]], axis=1),
        ]
    )
    both = np.concatenate([odd_sign, odd_sign])
    inside = np.concatenate([triangles[count == 3], tip[odd_sign], base[~both]])
    outside = np.concatenate([triangles[count == 0], tip[~odd_sign], base[both]])
    return compact(Mesh(vertices, inside)), compact(Mesh(vertices, outside))


def part(name: str, mesh: Mesh, material: Material, smooth: bool = True) -> Part:
    """Make a part out of a mesh.

    Parameters
    ----------
    name : str
        What it is, unique within its object.
    mesh : Mesh
        Its surface.
    material : Material
        Its material.
    smooth : bool
        False to shade its facets flat.

    Returns
    -------
    Part
        The part.
    """
    return Part(name, mesh.vertices, mesh.triangles, material, smooth)


def finished(parts: Sequence[Part], height_m: float, centre: bool = False) -> tuple[Part, ...]:
    """Scale an object to its height and stand it on the floor.

    Parameters
    ----------
    parts : sequence of Part
        The object, in any unit of length.
    height_m : float
        Height of the finished object [m].
    centre : bool
        True to bring the middle of its bounding box onto the z axis; False to keep the axis.

    Returns
    -------
    tuple of Part
        The object in metres, from z = 0 to z = height_m, without degenerate triangles or empty
        parts.
    """
    everything = np.concatenate([piece.vertices for piece in parts])
    low, high = everything.min(axis=0), everything.max(axis=0)
    origin = np.array([0.0, 0.0, low[2]])
    if centre:
        origin[:2] = (low[:2] + high[:2]) / 2
    scale = height_m / (high[2] - low[2])
    result = []
    for piece in parts:
        mesh = Mesh((piece.vertices - origin) * scale, piece.triangles)
        mesh = Mesh(mesh.vertices, mesh.triangles[areas(mesh) > SMALLEST_AREA_M2])
        if len(mesh.triangles):
            result.append(part(piece.name, compact(mesh), piece.material, piece.smooth))
    return tuple(result)
