"""Household things: a ball, a pile of books and a cushion."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from ..shape import Material, Part, Rgb
from .grid import box, convex
from .mesh import Mesh, compact, finished, merged, part
from .sweep import lathe, tube

COVERS: tuple[Rgb, ...] = (
    (0.035, 0.085, 0.25),
    (0.05, 0.20, 0.13),
    (0.50, 0.40, 0.12),
    (0.12, 0.30, 0.38),
    (0.10, 0.10, 0.115),
    (0.42, 0.39, 0.33),
    (0.14, 0.09, 0.24),
)
PAPER: Rgb = (0.70, 0.67, 0.58)


def ball(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a ball with blue and white panels.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses how it has rolled.
    height_m : float
        Its diameter [m].

    Returns
    -------
    tuple of Part
        The ball.
    """
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 49)
    line = np.stack([np.cos(latitude), np.sin(latitude)], axis=1)
    line[[0, -1], 0] = 0.0
    sphere = lathe(line, 96)
    centre = sphere.vertices[sphere.triangles].mean(axis=1)
    panel = np.floor(np.arctan2(centre[:, 1], centre[:, 0]) / (np.pi / 3)).astype(int) % 2 == 0
    blue = panel & (np.abs(centre[:, 2]) < 0.96)
    # A rotation from a random unit quaternion tipped only so far that panels are seen.
    w, x, y, z = _turned(generator)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    parts = []
    for name, mask, colour in (
        ("blue panels", blue, (0.03, 0.13, 0.50)),
        ("white panels", ~blue, (0.74, 0.74, 0.72)),
    ):
        mesh = compact(Mesh(sphere.vertices, sphere.triangles[mask])).moved(turn=turn)
        parts.append(part(name, mesh, Material(colour, roughness=0.15)))
    return finished(parts, height_m)


def _turned(generator: np.random.Generator) -> tuple[float, float, float, float]:
    """Choose a rotation, as a quaternion: up to 60 degrees about a level axis."""
    half = 0.5 * np.radians(generator.uniform(20, 60))
    way = generator.uniform(0, 2 * np.pi)
    return np.cos(half), np.sin(half) * np.cos(way), np.sin(half) * np.sin(way), 0.0


def books(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a pile of hardcover books.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses number, sizes, colours and how carelessly they are piled.
    height_m : float
        Height of the pile [m].

    Returns
    -------
    tuple of Part
        The books: a cover for each, all the paper, and the labels on the spines.
    """
    count = int(generator.integers(4, 7))
    colours = generator.permutation(len(COVERS))[:count]
    level = 0.0
    parts, paper, labels = [], [], []
    long = generator.uniform(0.25, 0.28)
    for number, colour in enumerate(colours):
        thick = generator.uniform(0.020, 0.042)
        deep, board = long * generator.uniform(0.66, 0.74), 0.0028
        yaw = generator.normal(0, 0.13) + (np.pi if generator.random() < 0.15 else 0.0)
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        shift = np.array([*generator.normal(0, 0.008, 2), level])
        spine = _spine(long, deep, thick)
        cover = [
            box((deep, long, board), 0.0006).moved((0, 0, board / 2)),
            box((deep, long, board), 0.0006).moved((0, 0, thick - board / 2)),
            spine,
        ]
        block = box((deep - 0.008, long - 0.010, thick - 1.9 * board), 0.0004)
        mesh = merged(cover).moved(shift, turn)
        # Flat facets: the spine is fine enough to look round.
        parts.append(
            part(f"cover {number + 1}", mesh, Material(COVERS[colour], roughness=0.4), smooth=False)
        )  # fmt: skip
        paper.append(block.moved((0.001, 0, thick / 2)).moved(shift, turn))
        place = 0.27 * long * (1 if generator.random() < 0.5 else -1)
        # The label is the spine again, cut short and a hair thicker.
        label = _spine(0.16 * long, deep, thick - 0.004, 0.0006).moved((0, place, 0.002))
        labels.append(label.moved(shift, turn))
        # A hair of air keeps the boards of two books from lying in one plane.
        level += thick + 0.0002
        long *= generator.uniform(0.88, 0.99)
    for name, meshes, material in (
        ("paper", paper, Material(PAPER)),
        ("labels", labels, Material((0.60, 0.52, 0.30), roughness=0.4)),
    ):
        mesh = merged(meshes)
        parts.append(part(name, mesh, material, smooth=False))
    return finished(parts, height_m, centre=True)


def _spine(long: float, deep: float, thick: float, swell: float = 0.0) -> Mesh:
    """Make the rounded back of a book, at the end of its boards towards -x."""
    t = np.linspace(-np.pi / 2, np.pi / 2, 17)
    x = -deep / 2 - (0.22 * thick + swell) * np.cos(t) + 0.002
    z = thick / 2 * (1 + np.sin(t))
    outline = np.stack([x, z], axis=1)
    corners = [np.insert(outline, 1, y, axis=1) for y in (-long / 2, long / 2)]
    return convex(np.concatenate(corners))


def cushion(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a square cushion with stripes and piping, lying flat.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses colours, creases and direction.
    height_m : float
        Its thickness in the middle [m]; it is about three times as wide.

    Returns
    -------
    tuple of Part
        The cushion.
    """
    n = 61
    u = np.sin(np.linspace(-np.pi / 2, np.pi / 2, n))
    x, y = np.meshgrid(u, u, indexing="ij")
    # Sides are pulled in where the filling is thick; the corners stick out.
    wide = x * (1 - 0.10 * (1 - y**2)), y * (1 - 0.10 * (1 - x**2))
    body = (np.clip(1 - x**2, 0, 1) * np.clip(1 - y**2, 0, 1)) ** 0.42
    phase = generator.uniform(0, 2 * np.pi, 4)
    crease = 0.02 * np.sin(9 * x + 4 * y + phase[0]) * np.sin(7 * y - 3 * x + phase[1])
    crease += 0.03 * np.sin(11 * np.arctan2(y, x) + phase[2]) * np.hypot(x, y) ** 2
    top = 0.38 * body * (1 + crease)
    # The corners hang down to the floor, on which the underside lies flat.
    hang = 0.15 * ((x**2 + y**2) / 2) ** 1.5
    top -= hang
    bottom = np.maximum(-0.30 * body - hang, -0.20 - 0.03 * body)
    index = np.arange(n * n).reshape(n, n)
    under = index + n * n
    rim = np.zeros((n, n), bool)
    rim[[0, -1]] = rim[:, [0, -1]] = True
    under[rim] = index[rim]
    bottom[rim] = top[rim]
    vertices = np.concatenate([np.stack([*wide, z], axis=-1).reshape(-1, 3) for z in (top, bottom)])
    band = np.floor((u[1:] + u[:-1]) / 2 * 5.5 + 20.5).astype(int) % 2 == 0
    angle = generator.uniform(0, 2 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    cloths: tuple[Rgb, ...] = ((0.06, 0.15, 0.30), (0.13, 0.27, 0.22), (0.46, 0.36, 0.12))
    cloth = Material(cloths[int(generator.integers(len(cloths)))])
    cream = Material((0.66, 0.63, 0.55))
    parts = []
    for name, mask, material in (("stripes", band, cloth), ("ground", ~band, cream)):
        mesh = Mesh(vertices, np.concatenate([_cells(index, mask), _cells(under, mask)[:, ::-1]]))
        parts.append(part(name, compact(mesh).moved(turn=turn), material))
    ring = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
    seam = tube(_evened(vertices[ring]), 0.022, 8, up=(0, 0, 1), closed=True)
    parts.append(part("piping", seam.moved(turn=turn), cloth))
    return finished(parts, height_m)


def _cells(index: Int[np.ndarray, "n n"], rows: Bool[np.ndarray, " m"]) -> Int[np.ndarray, "t 3"]:
    """Join the chosen rows of a grid, whose rows run along x and columns along y."""
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1)[rows].reshape(-1, 3)
    # A triangle with all its corners on the seam would lie on its twin of the other side.
    last = len(index) - 1
    line, place = triangles % index.size // len(index), triangles % len(index)
    on_seam = np.isin(line, (0, last)) | np.isin(place, (0, last))
    return triangles[~on_seam.all(axis=1)]


def _evened(ring: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Resample a closed line evenly and round its corners."""
    closed = np.concatenate([ring, ring[:1]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0, length[-1], 240, endpoint=False)
    even = np.stack([np.interp(at, length, closed[:, k]) for k in range(3)], axis=1)
    for _ in range(3):
        even = 0.5 * even + 0.25 * (np.roll(even, 1, axis=0) + np.roll(even, -1, axis=0))
    return even
