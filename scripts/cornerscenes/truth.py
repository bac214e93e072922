"""What is true of a scene: corners, edges and faces, as projected and as seen."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from cornerscenes.camera import inverse, transformed
from cornerscenes.film import SeenCorner
from cornerscenes.mitsuba_backend import World
from cornerscenes.noise_floor import SeenEdge
from cornerscenes.placement import visible_fraction
from cornerscenes.scene import Scene

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
    eye = scene.eye_m
    facing = set(scene.target.facing(eye))
    vertices = scene.target.vertices_m()
    image_points = scene.image_of(vertices)
    on_sensor = scene.camera.contains(image_points)
    hidden = world.occluded(eye, vertices)
    wireframe = scene.target.wireframe
    corners = []
    for index in range(len(vertices)):
        if not facing & set(wireframe.faces_at(index)):
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
                "edges": _edges_at(scene, image_points, facing, index),
                "blur_px": _blur_px(scene, vertices[index]),
                "faces": wireframe.faces_at(index),
            }
        )
    return {
        "corners": corners,
        "edges": [_edge(scene, world, facing, index) for index in range(len(wireframe.edges))],
        "faces": [_face(scene, world, facing, index) for index in range(len(wireframe.faces))],
        "target_visible_fraction": visible_fraction(
            scene.target, eye, lambda points: world.occluded(eye, points), FACE_CELLS
        ),
    }


def _edges_at(scene: Scene, image_points: Any, facing: set[int], index: int) -> list[Any]:
    found = []
    for edge in scene.target.wireframe.edges_at(index):
        if not facing & set(scene.target.wireframe.edge_faces[edge]):
            continue
        a, b = scene.target.wireframe.edges[edge]
        along = image_points[b if a == index else a] - image_points[index]
        length = float(np.linalg.norm(along))
        found.append(
            {
                "edge": edge,
                "direction": (along / length).tolist(),
                "length_px": length,
                "visible_length_px": length,
            }
        )
    return found


def _blur_px(scene: Scene, point_m: Any) -> float:
    if scene.lens is None:
        return 0.0
    depth_m = transformed(inverse(scene.world_from_camera), point_m[None])[0, 2]
    return 0.5 * scene.lens.blur_radius_px(float(depth_m), scene.camera.fx_px)


def _seen(scene: Scene, world: World, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    on_sensor = scene.camera.contains(scene.image_of(points))
    return on_sensor & ~world.occluded(scene.eye_m, points)


def _edge(scene: Scene, world: World, facing: set[int], index: int) -> dict[str, Any]:
    ends, faces = scene.target.wireframe.edges[index], scene.target.wireframe.edge_faces[index]
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
    wireframe = scene.target.wireframe
    corners = scene.target.vertices_m()[list(wireframe.faces[index])]
    centre = corners.mean(axis=0)
    fraction = 0.0
    if index in facing:
        points = scene.target.face_points_m(index, FACE_CELLS)
        fraction = float(_seen(scene, world, points).mean())
    return {
        "index": index,
        "name": wireframe.face_names[index],
        "corners": list(wireframe.faces[index]),
        "facing": index in facing,
        "visible_fraction": fraction,
        "centre_m": centre.tolist(),
        "centre_image_point_px": scene.image_of(centre[None])[0].tolist(),
        "normal": scene.target.normal(index).tolist(),
        "extent_m": list(scene.target.face_extent_m(index)),
    }


def seen_corners(content: dict[str, Any]) -> list[SeenCorner]:
    """Return the corners that truth.json's content calls visible, with their edges."""
    found = []
    for corner in content["corners"]:
        if corner["visibility"] != "visible":
            continue
        edges = tuple(
            SeenEdge(np.array(edge["direction"]), edge["visible_length_px"])
            for edge in corner["edges"]
            if edge["visible_length_px"] > 0.0
        )
        found.append(SeenCorner(np.array(corner["image_point_px"]), edges, corner["blur_px"]))
    return found
