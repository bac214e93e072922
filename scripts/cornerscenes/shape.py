"""Triangle meshes and the materials they carry: what an object is before any renderer sees it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

Rgb = tuple[float, float, float]

Texture = Float[np.ndarray, "h w 3"]


@dataclass(frozen=True)
class Material:
    """How a surface reflects light.

    Attributes
    ----------
    colour : Rgb
        Diffuse reflectance, linear Rec. 709, each channel in [0, 1].
    roughness : float or None
        GGX roughness of a dielectric coat over the diffuse base (plastic, glaze, varnish, wet
        leaf), in (0, 1]; `None` for a matt surface without a coat.
    two_sided : bool
        True for sheets such as leaves, which are seen from both sides.
    texture : Texture or None
        Takes the place of `colour` on parts that have texture coordinates.
    metallic : float
        Share of the reflection that is a metal's, in [0, 1]: metallic paint.
    """

    colour: Rgb
    roughness: float | None = None
    two_sided: bool = False
    texture: Texture | None = None
    metallic: float = 0.0


@dataclass(frozen=True)
class Part:
    """A triangle mesh of one material, in the frame of the object it belongs to.

    Attributes
    ----------
    name : str
        What it is ("leaf", "pot"), unique within the object.
    vertices : Float[np.ndarray, "n 3"]
        Positions [m], z up. An object stands on z = 0 around the z axis.
    triangles : Int[np.ndarray, "m 3"]
        Vertex indices, counter-clockwise seen from outside.
    material : Material
        Its one material.
    smooth : bool
        True where shading normals are interpolated over the mesh, False for flat facets.
    normals : Float[np.ndarray, "n 3"] or None
        Exact unit normals at the vertices of a smooth part, where they are known.
    uv : Float[np.ndarray, "n 2"] or None
        Texture coordinates at the vertices, each in [0, 1].
    face : int or None
        On a target: the face that it is, or `FILLET`.
    corners_m : Float[np.ndarray, "k 3"] or None
        Points where its flat faces meet and that look like corners.
    """

    name: str
    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    material: Material
    smooth: bool = True
    normals: Float[np.ndarray, "n 3"] | None = None
    uv: Float[np.ndarray, "n 2"] | None = None
    face: int | None = None
    corners_m: Float[np.ndarray, "k 3"] | None = None


def joined(parts: Sequence[Part]) -> Part:
    """Return several parts as one of plain facets, for what asks only for their geometry."""
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Part(
        name="joined",
        vertices=np.concatenate([part.vertices for part in parts]),
        triangles=np.concatenate(
            [part.triangles + first for part, first in zip(parts, firsts, strict=True)]
        ),
        material=Material((0.5, 0.5, 0.5)),
        smooth=False,
    )


def vertex_normals(
    vertices: Float[np.ndarray, "n 3"], triangles: Int[np.ndarray, "m 3"]
) -> Float[np.ndarray, "n 3"]:
    """Return unit normals at vertices: those of their triangles, weighted by the angle there.

    Parameters
    ----------
    vertices : Float[np.ndarray, "n 3"]
        Positions [m].
    triangles : Int[np.ndarray, "m 3"]
        Vertex indices, none of them degenerate.
    """
    corners = vertices[triangles]
    facet = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    normals = np.zeros_like(vertices)
    for index in range(3):
        one = corners[:, (index + 1) % 3] - corners[:, index]
        other = corners[:, (index + 2) % 3] - corners[:, index]
        sine = np.linalg.norm(np.cross(one, other), axis=1)
        angle = np.arctan2(sine, np.einsum("ij,ij->i", one, other))
        np.add.at(normals, triangles[:, index], angle[:, None] * facet)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(
        normals, length, out=np.tile([0.0, 0.0, 1.0], (len(normals), 1)), where=length > 0
    )
