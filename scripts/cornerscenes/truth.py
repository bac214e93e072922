"""What is true of a scene: corners, edges and faces, as projected and as seen."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from cornerscenes import cuboid
from cornerscenes.camera import inverse, transformed
from cornerscenes.layout import Scene, visible_fraction
from cornerscenes.mitsuba_backend import World

# Samples: cells per side of a face, points per edge.
FACE_CELLS = 96
EDGE_POINTS = 512


def truth(scene: Scene, world: World) -> dict[str, Any]:
    """Return the content of truth.json.

    Corners are the ideal vertices (intersections of the planes), projected in float64. A corner is
    `visible`, `occluded` by another object, `self-occluded`, or `outside` the image. A visible
    fraction is the share of an edge's length or a face's area in the world that is in the frame and
    that nothing hides; 0 for what faces away.

    Parameters
    ----------
    scene : Scene
        The resolved scene.
    world : World
        The same scene as the renderer holds it; every visibility is a ray cast in it.
    """
    eye = scene.world_from_camera[:3, 3]
    facing = set(scene.target.facing(eye))
    vertices = scene.target.vertices_m()
    image_points = image_of(scene, vertices)
    on_sensor = scene.camera.contains(image_points)
    hidden = world.occluded(eye, vertices)
    corners = []
    for index in range(8):
        if not facing & set(cuboid.faces_of_vertex(index)):
            visibility = "self-occluded"
        elif not on_sensor[index]:
            visibility = "outside"
        else:
            visibility = "occluded" if hidden[index] else "visible"
        corners.append(
            {
                "index": index,
                "position_m": vertices[index].tolist(),
                "image_point_px": image_points[index].tolist(),
                "visibility": visibility,
                "faces": list(cuboid.faces_of_vertex(index)),
            }
        )
    return {
        "corners": corners,
        "edges": [_edge(scene, world, facing, index) for index in range(len(cuboid.EDGES))],
        "faces": [_face(scene, world, facing, index) for index in range(6)],
        "target_visible_fraction": visible_fraction(
            scene.target, eye, lambda points: world.occluded(eye, points), FACE_CELLS
        ),
    }


def image_of(scene: Scene, points_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Return the image points [px] of points in the world [m], which are before the camera."""
    return scene.camera.project(transformed(inverse(scene.world_from_camera), points_m))


def _seen(scene: Scene, world: World, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    on_sensor = scene.camera.contains(image_of(scene, points))
    return on_sensor & ~world.occluded(scene.world_from_camera[:3, 3], points)


def _edge(scene: Scene, world: World, facing: set[int], index: int) -> dict[str, Any]:
    ends = cuboid.EDGES[index]
    faces = cuboid.faces_of_edge(ends)
    fraction = 0.0
    if facing & set(faces):
        start, end = scene.target.vertices_m()[list(ends)]
        steps = (np.arange(EDGE_POINTS) + 0.5) / EDGE_POINTS
        points = start + steps[:, None] * (end - start)
        fraction = float(_seen(scene, world, points).mean())
    return {
        "index": index,
        "corners": list(ends),
        "faces": list(faces),
        "visible_fraction": fraction,
    }


def _face(scene: Scene, world: World, facing: set[int], index: int) -> dict[str, Any]:
    corners = scene.target.vertices_m()[list(cuboid.FACES[index])]
    centre = corners.mean(axis=0)
    fraction = 0.0
    if index in facing:
        points = scene.target.face_points_m(index, FACE_CELLS)
        fraction = float(_seen(scene, world, points).mean())
    return {
        "index": index,
        "name": cuboid.FACE_NAMES[index],
        "corners": list(cuboid.FACES[index]),
        "facing": index in facing,
        "visible_fraction": fraction,
        "centre_m": centre.tolist(),
        "centre_image_point_px": image_of(scene, centre[None])[0].tolist(),
        "normal": scene.target.normal(index).tolist(),
        "extent_m": [
            float(np.linalg.norm(corners[1] - corners[0])),
            float(np.linalg.norm(corners[3] - corners[0])),
        ],
    }
