"""Truth against brute force in float64, written without the renderer, and against hand numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import CAMERA, SIZE, checkerboard, is_hidden, scene, slab, target, triangles_of

from cornerscenes import cuboid, mitsuba_backend
from cornerscenes.camera import Camera, inverse, looking_at, standing, transformed
from cornerscenes.light import Lamp, Light
from cornerscenes.mitsuba_backend import World
from cornerscenes.noise_floor import SeenEdge, sides
from cornerscenes.scene import FIRST_OBJECT_ID, Lens, Scene
from cornerscenes.truth import add_from_film, junction, truth


@pytest.fixture(scope="module", autouse=True)
def _variant():
    mitsuba_backend.choose_variant()


def truth_of(drawn: Scene) -> dict:
    return truth(drawn, World.of(drawn, 2))


@pytest.mark.parametrize("objects", [(), (slab(),)])
def test_corner_visibility_equals_brute_force(objects: tuple):
    drawn = scene(*objects)
    found = truth_of(drawn)
    triangles = triangles_of(drawn)
    seen = [corner["visibility"] == "visible" for corner in found["corners"]]
    expected = [
        not is_hidden(drawn.eye_m, np.array(corner["position_m"]), triangles)
        for corner in found["corners"]
    ]
    assert seen == expected
    kinds = [corner["visibility"] for corner in found["corners"]]
    assert kinds.count("self-occluded") == 1
    assert ("occluded" in kinds) == bool(objects)
    assert sum(seen) == 7 - kinds.count("occluded")


def test_fractions_of_faces_and_edges_equal_brute_force():
    drawn = scene(slab())
    found = truth_of(drawn)
    triangles = triangles_of(drawn)
    eye = drawn.eye_m
    facing = drawn.target.facing(eye)
    assert len(facing) == 3
    partly = 0
    for face in found["faces"]:
        points = drawn.target.face_points_m(face["index"], 24)
        shown = np.mean([not is_hidden(eye, point, triangles) for point in points])
        assert face["facing"] == (face["index"] in facing)
        expected = shown if face["facing"] else 0.0
        assert face["visible_fraction"] == pytest.approx(expected, abs=0.02)
        partly += 0.05 < face["visible_fraction"] < 0.95
    assert partly >= 1
    assert 0.3 < found["target_visible_fraction"] < 0.95


def test_the_seen_parts_of_every_edge_end_where_brute_force_says():
    drawn = scene(slab(), slab(standing(0.05, 0.15, 0.2), (0.01, 0.02, 0.3), FIRST_OBJECT_ID + 1))
    found = truth_of(drawn)
    triangles = triangles_of(drawn, with_target=False)
    vertices, facing = drawn.target.vertices_m(), set(drawn.target.facing(drawn.eye_m))
    ends = set()
    for edge in found["edges"]:
        start, end = vertices[edge["corners"]]

        def is_seen(share: float, start: np.ndarray = start, end: np.ndarray = end) -> bool:
            return not is_hidden(drawn.eye_m, start + share * (end - start), triangles)

        parts = edge["visible"]
        if not facing & set(edge["faces"]):
            assert parts == []
            continue
        inside = np.random.default_rng(1).random(400)
        for share in inside:
            shown = any(part["start"] < share < part["end"] for part in parts)
            assert shown == is_seen(share), (edge["index"], share)
        for part in parts:
            for share, by, outwards in (
                (part["start"], part["started_by"], -1.0),
                (part["end"], part["ended_by"], 1.0),
            ):
                ends.add(by)
                if by == "vertex":
                    assert share in (0.0, 1.0)
                else:
                    assert is_seen(share - outwards * 1e-7)
                    assert not is_seen(share + outwards * 1e-7)
        shown = sum(part["end"] - part["start"] for part in parts)
        assert edge["visible_fraction"] == pytest.approx(shown)
    assert ends == {"vertex", FIRST_OBJECT_ID, FIRST_OBJECT_ID + 1}


def from_above(*objects: object, **changes: object) -> Scene:
    """Return the cuboid, unturned, seen from straight above its middle by a camera 1 m up."""
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[:3, 3] = 0.2, 0.2, 1.0
    body = replace(target(), world_from_target=standing(0.2, 0.2, 0.0))
    return scene(*objects, target=body, world_from_camera=down, **changes)  # pyright: ignore


def test_a_t_junction_is_where_the_board_s_edge_projects_to():
    # A board of 6 cm at a height of 0.5 m spans x = 0.24 to 0.30 m there: seen from (0.2, 0.2, 1)
    # its lower side, 0.501 m away, covers of the cuboid's top (0.82 m) what is beyond 0.04 * 0.82 /
    # 0.501 to the right of the middle.
    pose = standing(0.27, 0.2, 0.0)
    pose[2, 3] = 0.499
    drawn = from_above(slab(pose, (0.06, 0.5, 0.001)))
    found = truth_of(drawn)
    edges = [j for j in found["false_junctions"] if j["edge"] is not None]
    tops = [j for j in edges if abs(j["position_m"][2] - 0.18) < 1e-9]
    assert len(tops) == 2
    for one in tops:
        assert one["cause"] == "T"
        assert one["name"] == "board"
        assert one["object_id"] == FIRST_OBJECT_ID
        assert one["position_m"][0] == pytest.approx(0.2 + 0.04 * 0.82 / 0.501, abs=1e-9)
        x = CAMERA.cx_px + CAMERA.fx_px * 0.04 / 0.501
        y = CAMERA.cy_px - CAMERA.fx_px * (one["position_m"][1] - 0.2) / 0.82
        assert one["image_point_px"] == pytest.approx([x, y], abs=1e-9)
    # Two of the top's corners are hidden; the edges of the others end at the T junctions.
    tops = [corner for corner in found["corners"] if corner["position_m"][2] > 0.1]
    assert [corner["visibility"] for corner in tops] == ["visible", "occluded"] * 2
    for corner in tops[::2]:
        assert corner["junction"] == "L"
        lengths = sorted(edge["visible_length_px"] for edge in corner["edges"])
        cut = CAMERA.fx_px * (0.08 / 0.82 + 0.04 / 0.501)
        whole = CAMERA.fx_px * 0.12 / 0.82
        assert lengths == pytest.approx(sorted([cut, whole]), abs=1e-9)
        # The board's own edge is before the corner, as far as its T junctions.
        assert corner["nearest_occluder_px"] == pytest.approx(cut, abs=1e-9)
        (face,) = corner["faces"]
        assert face["near_visible_fraction"] == 1.0


def test_where_a_line_of_the_room_goes_behind_the_target_is_a_t_junction():
    drawn = scene()
    found = [j for j in truth_of(drawn)["false_junctions"] if j["cause"] == "T"]
    assert found
    triangles = triangles_of(drawn)
    for one in found:
        assert one["object_id"] == 1
        assert one["edge"] is None
        line = next(line for line in drawn.lines if line.name == one["name"])
        along = (line.end_m - line.start_m) / np.linalg.norm(line.end_m - line.start_m)
        place = np.array(one["position_m"])
        hidden = [is_hidden(drawn.eye_m, place + step * along, triangles) for step in (-1e-6, 1e-6)]
        assert sorted(hidden) == [False, True]
    rooms = [j for j in truth_of(drawn)["false_junctions"] if j["cause"] == "room"]
    inner = drawn.lines[0].start_m
    assert [j["position_m"] for j in rooms] in ([], [inner.tolist()])


def test_junctions_are_named_by_what_is_seen_of_their_edges():
    found = truth_of(scene())
    kinds = [corner["junction"] for corner in found["corners"]]
    assert sorted(filter(None, kinds)) == ["L"] * 3 + ["Y"] + ["arrow"] * 3
    for corner in found["corners"]:
        assert (corner["junction"] is None) == (corner["visibility"] != "visible")
        if corner["junction"] in ("Y", "arrow"):
            # Y: the three faces show; arrow: two.
            assert len(corner["faces"]) == (3 if corner["junction"] == "Y" else 2)
    edges = [{"direction": [np.cos(a), np.sin(a)], "visible_length_px": 9.0} for a in (0, 2, 4)]
    assert junction(edges, False) == "Y"
    assert junction(edges[:2], False) == "L"
    assert junction(edges[:1], False) == "edge end"
    assert junction([], False) is None
    edges[2]["visible_length_px"] = 0.9
    assert junction(edges, False) == "L"


def test_a_board_has_x_inside_and_l_on_the_rim():
    drawn = scene(target=checkerboard())
    found = truth_of(drawn)
    assert len(found["corners"]) == 24
    for corner in found["corners"]:
        column, row = corner["index"] % 6, corner["index"] // 6
        inside = 0 < column < 5 and 0 < row < 3
        assert corner["visibility"] == "visible"
        assert corner["junction"] == ("X" if inside else "L")
        assert [face["face"] for face in corner["faces"]] == [0]


def shadow_scene(lamp: Lamp) -> Scene:
    return from_above(light=Light((0, 0, 0), (0, 0, 0), (0, 0, 0), (lamp,)))


def test_the_shadow_of_a_point_lamp_has_corners_where_its_rays_past_the_vertices_end():
    lamp = Lamp("point", (1, 1, 1), (-0.3, 0.2, 0.9), (0.2, 0.2, 0.09))
    found = [
        j
        for j in truth_of(shadow_scene(lamp))["false_junctions"]
        if j["cause"] == "shadow" and "floor" in j["name"] and "vertex" in j["name"]
    ]
    # The four vertices of the top are on the outline that the lamp sees; at 0.9 / 0.72 of the way
    # to them their rays reach the floor.
    expected = [
        [-0.3 + x * 0.9 / 0.72, 0.2 + y * 0.9 / 0.72, 0.0]
        for x in (0.42, 0.58)
        for y in (-0.06, 0.06)
    ]
    positions = sorted(j["position_m"] for j in found)
    assert np.abs(np.array(positions) - expected).max() < 1e-12


SUN = Lamp("sun", (1, 1, 1), (-1.0, 0.1, 1.0), (0.0, 0.2, 0.5))  # along (1, 0.1, -0.5)


def test_the_sun_s_shadow_is_parallel_and_bends_where_the_floor_meets_the_wall():
    found = [j for j in truth_of(shadow_scene(SUN))["false_junctions"] if j["cause"] == "shadow"]
    at_wall = [j["position_m"] for j in found if j["name"].startswith("vertex")]
    at_wall.sort(key=lambda place: place[1] + place[2])
    # The wall at x = 0.45 is 0.17 m behind two of the top's vertices and 0.33 behind the third.
    expected = [[0.45, 0.157, 0.095], [0.45, 0.293, 0.015], [0.45, 0.277, 0.095]]
    assert np.abs(np.array(at_wall) - expected).max() < 1e-9
    bends = sorted(j["position_m"] for j in found if j["name"].startswith("floor and wall_x"))
    assert np.abs(np.array(bends) - [[0.45, 0.157, 0.0], [0.45, 0.293, 0.0]]).max() < 1e-9


def test_a_shadow_corner_that_another_shadow_swallows_is_none():
    high = standing(0.0, 0.2, 0.0)
    high[2, 3] = 0.05
    screen = slab(high, (0.01, 0.6, 0.6))
    drawn = replace(shadow_scene(SUN), objects=(screen,))
    causes = [j["cause"] for j in truth_of(drawn)["false_junctions"]]
    assert "shadow" not in causes


def test_corners_of_print_are_false_junctions_where_their_side_is_seen():
    half_x, half_y = 0.5 * SIZE[0], 0.5 * SIZE[1]
    points = np.array([[-half_x, 0.01, 0.1], [half_x, 0.01, 0.1], [0.0, -half_y, 0.1]])
    drawn = scene(target=replace(target(), texture_corners_m=points))
    found = [j for j in truth_of(drawn)["false_junctions"] if j["cause"] == "texture"]
    expected = transformed(drawn.target.world_from_target, points[[0, 2]])
    assert np.abs(np.array([j["position_m"] for j in found]) - expected).max() < 1e-12


def test_a_false_junction_at_a_true_corner_is_not_listed():
    drawn = scene(target=replace(target(), texture_corners_m=cuboid.vertices(SIZE)))
    assert not [j for j in truth_of(drawn)["false_junctions"] if j["cause"] == "texture"]


def test_the_nearest_occluder_is_as_near_as_rays_around_the_corner_say():
    drawn = scene(slab())
    triangles = triangles_of(drawn, with_target=False)
    compared = 0
    for corner in truth_of(drawn)["corners"]:
        if corner["visibility"] != "visible" or corner["nearest_occluder_px"] is None:
            continue
        point, found = np.array(corner["image_point_px"]), corner["nearest_occluder_px"]
        depth = transformed(inverse(drawn.world_from_camera), np.array(corner["position_m"])[None])[
            0, 2
        ]
        angles = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)

        def meets(radius: float, point=point, ring=ring, depth=depth) -> bool:
            rays = drawn.camera.rays(point + radius * ring) @ drawn.world_from_camera[:3, :3].T
            return any(is_hidden(drawn.eye_m, drawn.eye_m + depth * r, triangles) for r in rays)

        assert not meets(found - 0.02)
        assert meets(found + 0.1)
        compared += 1
    assert compared >= 2


def test_the_apex_of_a_rounded_corner_is_the_image_of_its_farthest_vertex():
    drawn = scene(target=target(0.02))
    found = truth_of(drawn)
    meshes = np.concatenate([part.vertices for part in drawn.target.parts])
    for corner in found["corners"]:
        ideal = drawn.target.wireframe.vertices_m[corner["index"]]
        # The sphere about the point 2 cm inside of all three faces.
        outwards = np.sign(ideal - [0.0, 0.0, 0.5 * SIZE[2]])
        apex = ideal - 0.02 * outwards + 0.02 * outwards / np.sqrt(3.0)
        assert np.linalg.norm(meshes - apex, axis=1).min() < 1e-3
        (expected,) = drawn.image_of(transformed(drawn.target.world_from_target, apex[None]))
        assert corner["apex_image_point_px"] == pytest.approx(expected.tolist(), abs=1e-9)
        assert 0.5 < corner["bevel_radius_px"] / (0.02 * CAMERA.fx_px / 0.8) < 2.0
    assert all(c["apex_image_point_px"] is None for c in truth_of(scene())["corners"])


def test_a_corner_outside_the_frame_is_outside_and_edges_end_at_the_frame():
    narrow = Camera.with_field_of_view(96, 80, 8.0)
    found = truth_of(scene(camera=narrow))
    kinds = {corner["visibility"] for corner in found["corners"]}
    assert "outside" in kinds
    assert "visible" in kinds or "self-occluded" in kinds
    ends = 0
    for edge in found["edges"]:
        for part in edge["visible"]:
            vertices = np.array([found["corners"][v]["position_m"] for v in edge["corners"]])
            for share, by in ((part["start"], part["started_by"]), (part["end"], part["ended_by"])):
                if by == "frame":
                    place = vertices[0] + share * (vertices[1] - vertices[0])
                    x, y = scene(camera=narrow).image_of(place[None])[0]
                    off = min(abs(x + 0.5), abs(x - 95.5), abs(y + 0.5), abs(y - 79.5))
                    assert off < 1e-8
                    ends += 1
    assert ends >= 2


def test_blur_is_that_of_the_lens_at_the_corner_s_depth():
    lens = Lens(0.01, 0.5)
    drawn = scene(lens=lens)
    for corner in truth_of(drawn)["corners"]:
        depth = transformed(inverse(drawn.world_from_camera), np.array(corner["position_m"])[None])[
            0, 2
        ]
        radius = 0.01 * abs(depth - 0.5) / depth / 0.5 * drawn.camera.fx_px
        assert corner["blur_px"] == pytest.approx(0.5 * radius)


def test_contrast_and_noise_floor_come_from_the_film_for_visible_corners():
    found = truth_of(scene(slab()))
    x = np.arange(CAMERA.width)[None, :, None]
    pixels = np.tile(np.where(x > 40, 0.8, 0.2), (CAMERA.height, 1, 3)).astype(float)
    variance = np.full(pixels.shape, 1e-6)
    add_from_film(found, pixels, variance)
    for corner in found["corners"]:
        for edge in corner["edges"]:
            if corner["visibility"] != "visible":
                assert edge["contrast"] is None
                continue
            seen = SeenEdge(np.array(edge["direction"]), edge["visible_length_px"])
            expected = sides(pixels, variance, np.array(corner["image_point_px"]), seen)
            assert edge["contrast"] == (None if expected is None else expected.contrast.tolist())
        if corner["visibility"] != "visible":
            assert corner["render_noise_floor_px"] is None


def test_faces_are_wound_counter_clockwise_seen_from_outside():
    vertices = cuboid.vertices(SIZE)
    for face, corners in enumerate(cuboid.FACES):
        a, b, c, _ = vertices[list(corners)]
        normal = np.cross(b - a, c - b)
        assert np.allclose(normal / np.linalg.norm(normal), cuboid.NORMALS[face])
    assert len(cuboid.EDGES) == 12
    assert cuboid.wireframe(SIZE).faces_at(0) == [0, 2, 4]


def test_an_edge_that_points_at_the_camera_is_a_point_and_nothing_breaks():
    drawn = scene()
    along = drawn.target.vertices_m()
    eye = along[7] + 3.0 * (along[7] - along[6])
    drawn = replace(drawn, world_from_camera=looking_at(eye, along[6]))
    edge = next(e for e in truth_of(drawn)["edges"] if sorted(e["corners"]) == [6, 7])
    assert edge["visible_fraction"] in (0.0, 1.0)
