"""Families and suites of scenes: what their TOML files hold."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from cornerscenes.objects import BUILDERS
from cornerscenes.streams import Factors
from cornerscenes.tables import (
    FieldOfView,
    Names,
    NotNegative,
    Point,
    Positive,
    PositiveRange,
    Range,
    SceneName,
    Split,
    Summary,
    Table,
    Unit,
    UnitRange,
    unknown_name,
)

# In a group of scenes dev and test take turns.
SPLITS: tuple[Split, ...] = ("dev", "test")

# How near a scene's visible fraction must come to the one that is drawn for it.
NEAR = 0.02


def _built(name: str) -> str:
    if name not in BUILDERS:
        raise ValueError(unknown_name("names no builder", name, sorted(BUILDERS)))
    return name


BuilderName = Annotated[
    str, AfterValidator(_built), Field(json_schema_extra={"enum": [*sorted(BUILDERS)]})
]


class LensRecipe(Table):
    """A thin lens; without one the camera is a pinhole."""

    aperture_radius_m: Annotated[PositiveRange, Field(description="radius of the aperture")]
    focus_offset_m: Annotated[
        Range, Field(description="how far behind the target's centre the plane in focus lies")
    ] = (0.0, 0.0)


class CameraRecipe(Table):
    """The colour camera."""

    width: Annotated[int, Field(ge=16, le=8192, description="pixels")]
    height: Annotated[int, Field(ge=16, le=8192, description="pixels")]
    horizontal_field_of_view_deg: FieldOfView
    lens: LensRecipe | None = None


class RangeSensorRecipe(Table):
    """The range sensor, parallel to the colour camera."""

    width: Annotated[int, Field(ge=1, le=4096, description="cells")]
    height: Annotated[int, Field(ge=1, le=4096, description="cells")]
    horizontal_field_of_view_deg: FieldOfView
    position_in_camera_m: Annotated[
        Point, Field(description="where it stands in the colour camera's frame")
    ] = (0.0, 0.0, 0.0)


class PoseRecipe(Table):
    """Where a camera stands, at a position or about the target, and what it looks at."""

    looks: Annotated[
        Literal["down", "at target"],
        Field(
            description="down, world y upwards in the image; or level and at the target's centre"
        ),
    ]
    position_m: Annotated[Point | None, Field(description="a position in the world")] = None
    jitter_m: Annotated[
        float, Field(ge=0.0, le=1.0, strict=False, description="largest shift of it on each axis")
    ] = 0.0
    azimuth_deg: Annotated[
        Range | None, Field(description="bearing of the camera from the target, from x towards y")
    ] = None
    elevation_deg: Annotated[
        Range | None, Field(description="elevation of the camera seen from the target")
    ] = None
    distance_m: Annotated[
        PositiveRange | None, Field(description="distance of the camera from the target's centre")
    ] = None
    across_px: Annotated[
        PositiveRange | None,
        Field(description="in place of the distance: length of the target's diagonal in the image"),
    ] = None
    off_centre: Annotated[
        float,
        Field(
            ge=0.0,
            le=0.45,
            strict=False,
            description="largest shift of the target from the middle, as a share of the image",
        ),
    ] = 0.0

    @model_validator(mode="after")
    def _one_way(self) -> PoseRecipe:
        orbit = (self.azimuth_deg, self.elevation_deg)
        if self.position_m is not None:
            if any(value is not None for value in (*orbit, self.distance_m, self.across_px)):
                raise ValueError(
                    "has position_m, so it has no azimuth_deg, elevation_deg, distance_m, across_px"
                )
        elif None in orbit or (self.distance_m is None) == (self.across_px is None):
            raise ValueError(
                "must have position_m, or azimuth_deg, elevation_deg and either distance_m or "
                "across_px"
            )
        elif self.looks == "down":
            raise ValueError("looks down, so it must have position_m")
        return self


class RoomRecipe(Table):
    """A floor and two walls that meet in a corner."""

    backgrounds: Annotated[Names, Field(description="names in backgrounds.toml; one is drawn")]
    wall_x_m: Annotated[Range, Field(description="where the wall across x stands")]
    wall_y_m: Annotated[Range, Field(description="where the wall across y stands")]
    extent_m: Annotated[
        float, Field(ge=0.5, le=100.0, strict=False, description="how far floor and walls reach")
    ]
    height_m: Annotated[
        float, Field(ge=0.1, le=100.0, strict=False, description="height of the walls")
    ]
    red_stripe_m: Annotated[
        Range | None, Field(description="lower and upper edge of a red stripe on one of the walls")
    ] = None


class BoardRecipe(Table):
    """A checkerboard in place of the cuboid; its margin is one square wide."""

    columns: Annotated[int, Field(ge=3, le=99, description="squares along x, odd")]
    rows: Annotated[int, Field(ge=3, le=99, description="squares along y, odd")]
    square_m: Annotated[PositiveRange, Field(description="side of a square")]

    @model_validator(mode="after")
    def _odd(self) -> BoardRecipe:
        for key in ("columns", "rows"):
            if getattr(self, key) % 2 == 0:
                raise ValueError(
                    f"{key} is {getattr(self, key)}, must be odd: all four outer squares are black"
                )
        return self


class TargetRecipe(Table):
    """The target: a cuboid, each dimension drawn from its own range, or a checkerboard."""

    materials: Annotated[Names, Field(description="names in materials.toml; one is drawn")]
    other_materials: Annotated[
        tuple[str, ...], Field(strict=False, description="names of materials that are not red")
    ] = ()
    other_share: Annotated[Unit, Field(description="share of scenes with one of them")] = 0.0
    length_m: Annotated[PositiveRange | None, Field(description="along the cuboid's x")] = None
    width_m: Annotated[PositiveRange | None, Field(description="along the cuboid's y")] = None
    height_m: Annotated[PositiveRange | None, Field(description="along the cuboid's z")] = None
    board: BoardRecipe | None = None
    bevel_px: Annotated[
        tuple[NotNegative, NotNegative] | None,
        Field(strict=False, description="radius of the cuboid's edges, in the image"),
    ] = None
    position_x_m: Annotated[Range, Field(description="where its middle stands along x")]
    position_y_m: Annotated[Range, Field(description="where its middle stands along y")]
    lift_m: Annotated[Range, Field(description="height of its lowest point above the floor")] = (
        0.0,
        0.0,
    )
    yaw_deg: Annotated[Range, Field(description="turn about the vertical")]
    tilt_deg: Annotated[Range, Field(description="before that: turn about its own x axis")] = (
        0.0,
        0.0,
    )

    @model_validator(mode="after")
    def _one_kind(self) -> TargetRecipe:
        sides = (self.length_m, self.width_m, self.height_m)
        if self.board is not None:
            if any(value is not None for value in (*sides, self.bevel_px)):
                raise ValueError("is a board, so it has no length_m, width_m, height_m, bevel_px")
        elif None in sides:
            raise ValueError("must have length_m, width_m and height_m, or a table board")
        if self.other_share > 0.0 and not self.other_materials:
            raise ValueError(f"has other_share = {self.other_share}, so it needs other_materials")
        return self


class ObjectRecipe(Table):
    """One object beside the target: an occluder stands between it and the camera."""

    builders: Annotated[
        tuple[BuilderName, ...],
        Field(min_length=1, strict=False, description="kinds of object; one is drawn"),
    ]
    height_m: Annotated[PositiveRange, Field(description="from the floor to its highest point")]
    role: Annotated[
        Literal["occluder", "bystander", "distractor"],
        Field(description="between target and camera; about the target; beside it and in view"),
    ]
    share: Annotated[Unit, Field(description="share of scenes that have it")] = 1.0


class Family(Table):
    """A kind of scene: ranges from which its scenes are drawn."""

    summary: Summary
    camera: CameraRecipe
    range_sensor: RangeSensorRecipe
    poses: Annotated[
        dict[str, PoseRecipe], Field(min_length=1, description="poses by name; one is drawn")
    ]
    room: RoomRecipe | None = None
    target: TargetRecipe
    objects: Annotated[
        tuple[ObjectRecipe, ...], Field(strict=False, description="what stands around the target")
    ] = ()
    lights: Annotated[Names, Field(description="names in lights.toml; one is drawn")]


class FilmRecipe(Table):
    """How finely a suite is rendered."""

    oversampling: Annotated[
        Literal[1, 2, 4, 8, 16], Field(description="film cells per pixel and direction, S")
    ]
    periphery_samples: Annotated[
        int,
        Field(ge=8, le=65536, multiple_of=4, description="paths per pixel outside the box"),
    ]
    fovea_samples: Annotated[
        int,
        Field(ge=8, le=65536, multiple_of=4, description="paths per film cell in the target's box"),
    ]
    corner_samples: Annotated[
        int, Field(ge=8, le=65536, description="most paths per film cell about the corners")
    ]
    noise_floor_px: Annotated[
        Positive,
        Field(description="no more of them than make the render noise floor as low as this"),
    ]
    margin_px: Annotated[int, Field(ge=0, le=512, description="margin of the target's box")]
    max_depth: Annotated[int, Field(ge=1, le=64, description="longest path; 2 is direct light")]

    @model_validator(mode="after")
    def _most_is_most(self) -> FilmRecipe:
        if self.corner_samples < self.fovea_samples:
            raise ValueError(
                f"corner_samples is {self.corner_samples}, must not be less than fovea_samples, "
                f"{self.fovea_samples}"
            )
        return self


FamilyName = Annotated[str, Field(description="a file of the folder families")]


class ExplicitScene(Table):
    """One scene, described by itself; its name draws it."""

    name: SceneName
    family: FamilyName
    pose: Annotated[
        str | None, Field(description="a pose of the family; drawn where not given")
    ] = None
    split: Annotated[Split, Field(description="which entries of the libraries it may take")]
    visible_fraction: Annotated[
        UnitRange | None,
        Field(description="share of the target's image that other objects leave free"),
    ] = None


class SceneGroup(Table):
    """Scenes of one family, drawn evenly over its factors, dev and test by turns."""

    family: FamilyName
    scenes: Annotated[int, Field(ge=1, le=65_536, description="how many")]
    poses: Annotated[
        tuple[str, ...], Field(strict=False, description="poses to draw from; all if empty")
    ] = ()
    visible_fraction: Annotated[
        UnitRange | None,
        Field(description="range from which each scene draws the share that is to be seen"),
    ] = None

    def names(self) -> list[str]:
        """Return the names of the scenes."""
        return [f"{self.family}-{index:04}" for index in range(self.scenes)]

    def expanded(self, suite: str) -> list[SceneRecipe]:
        """Return the scenes: of each range their factors share it out evenly."""
        found = []
        for index, name in enumerate(self.names()):
            # Each split shares out the ranges by itself.
            place, split = index // len(SPLITS), SPLITS[index % len(SPLITS)]
            group = f"{self.family}/{split}"
            fraction = None
            if self.visible_fraction is not None:
                wanted = Factors(f"{suite}/{group}", place).within(
                    "visible_fraction", self.visible_fraction
                )
                fraction = max(0.0, wanted - NEAR), min(1.0, wanted + NEAR)
            found.append(SceneRecipe(name, self.family, self.poses, split, fraction, group, place))
        return found


@dataclass(frozen=True)
class SceneRecipe:
    """One scene of a suite.

    Attributes
    ----------
    name, family : str
        Its name and its family's.
    poses : tuple[str, ...]
        Poses of the family to draw from; all of them where it is empty.
    split : Split
        Which entries of the libraries it may take.
    visible_fraction : tuple[float, float] or None
        Bounds of the share of the target's image that other objects leave free.
    group : str
        With the suite it names the sequences that its factors are points of.
    index : int
        Which points.
    """

    name: str
    family: str
    poses: tuple[str, ...]
    split: Split
    visible_fraction: tuple[float, float] | None
    group: str
    index: int


class Suite(Table):
    """A list of scenes to render, and how."""

    summary: Summary
    film: FilmRecipe
    scenes: Annotated[
        tuple[ExplicitScene, ...], Field(strict=False, description="scenes named one by one")
    ] = ()
    groups: Annotated[
        tuple[SceneGroup, ...], Field(strict=False, description="many scenes of a family each")
    ] = ()

    @model_validator(mode="after")
    def _distinct(self) -> Suite:
        names = [scene.name for scene in self.scenes]
        names += [name for group in self.groups for name in group.names()]
        twice = sorted({name for name, count in Counter(names).items() if count > 1})
        if twice:
            raise ValueError(f"names of scenes must differ, found twice: {', '.join(twice[:8])}")
        if not names:
            raise ValueError("has no scenes: add a table [[scenes]] or [[groups]]")
        return self

    def all_scenes(self, suite: str) -> list[SceneRecipe]:
        """Return every scene of the suite of this name, in its order."""
        explicit = [
            SceneRecipe(
                name=scene.name,
                family=scene.family,
                poses=() if scene.pose is None else (scene.pose,),
                split=scene.split,
                visible_fraction=scene.visible_fraction,
                group=scene.name,
                index=0,
            )
            for scene in self.scenes
        ]
        return explicit + [scene for group in self.groups for scene in group.expanded(suite)]
