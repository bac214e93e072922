"""Pinhole cameras and poses: the conventions of image, camera and world, on the Python side.

Image: x right, y down, pixels, the centre of the top-left pixel at (0, 0). Camera frame: x right,
y down, z forward. World: metres, z up. Poses are 4x4 matrices named ``a_from_b``.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, tan

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: size and intrinsics [px], the principal point in image coordinates."""

    width: int
    height: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    @classmethod
    def with_field_of_view(cls, width: int, height: int, horizontal_deg: float) -> Camera:
        """Return a centred camera of square pixels from its horizontal field of view [deg]."""
        focal_px = 0.5 * width / tan(radians(0.5 * horizontal_deg))
        middle_of_film = np.array([[0.5 * width, 0.5 * height]])
        ((cx_px, cy_px),) = image_points_from_film(middle_of_film, 1).tolist()
        return cls(width, height, focal_px, focal_px, cx_px, cy_px)

    def finer(self, oversampling: int) -> Camera:
        """Return the camera with each pixel divided into oversampling x oversampling."""
        scale = oversampling
        return Camera(
            self.width * scale,
            self.height * scale,
            self.fx_px * scale,
            self.fy_px * scale,
            (self.cx_px + 0.5) * scale - 0.5,
            (self.cy_px + 0.5) * scale - 0.5,
        )

    def project(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Return the image points [px] of points in the camera frame [m], which have z > 0."""
        x, y, z = points.T
        return np.stack([self.fx_px * x / z + self.cx_px, self.fy_px * y / z + self.cy_px], axis=1)

    def rays(self, image_points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Return directions in the camera frame, scaled to z = 1, of image points [px]."""
        x = (image_points[:, 0] - self.cx_px) / self.fx_px
        y = (image_points[:, 1] - self.cy_px) / self.fy_px
        return np.stack([x, y, np.ones_like(x)], axis=1)

    def pixel_centres(self) -> Float[np.ndarray, "n 2"]:
        """Return the image points [px] of all pixel centres, row by row."""
        y, x = np.mgrid[0 : self.height, 0 : self.width]
        return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)

    def contains(self, image_points: Float[np.ndarray, "n 2"]) -> np.ndarray:
        """Return whether image points [px] lie on the sensor, pixel areas included."""
        x, y = image_points.T
        inside_x = (x >= -0.5) & (x < self.width - 0.5)
        return inside_x & (y >= -0.5) & (y < self.height - 0.5)


def image_points_from_film(
    film: Float[np.ndarray, "n 2"], oversampling: int
) -> Float[np.ndarray, "n 2"]:
    """Return the image points [px] of film points: corners at integers become centres."""
    return film / oversampling - 0.5


def looking_down(position_m: tuple[float, float, float]) -> Float[np.ndarray, "4 4"]:
    """Return `world_from_camera` of a camera that faces the floor, world y upwards in its image."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = position_m
    return pose


def looking_at(
    position_m: Float[np.ndarray, "3"], target_m: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """Return `world_from_camera` of a level camera at a position whose axis meets a target [m].

    Straight above or below the target no camera is level: the result is NaN then.
    """
    forward = target_m - position_m
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    with np.errstate(invalid="ignore"):
        right = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position_m
    return pose


def standing(x_m: float, y_m: float, yaw_rad: float) -> Float[np.ndarray, "4 4"]:
    """Return `world_from_object` of what stands on the floor, turned about the vertical."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    pose = np.eye(4)
    pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
    pose[:2, 3] = x_m, y_m
    return pose


def transformed(
    a_from_b: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Return points in frame a of points in frame b [m]."""
    return points @ a_from_b[:3, :3].T + a_from_b[:3, 3]


def inverse(a_from_b: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """Return `b_from_a`, the inverse of a rigid motion, exactly orthonormal."""
    b_from_a = np.eye(4)
    b_from_a[:3, :3] = a_from_b[:3, :3].T
    b_from_a[:3, 3] = -a_from_b[:3, :3].T @ a_from_b[:3, 3]
    return b_from_a
