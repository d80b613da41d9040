"""Cameras that bend lines, and how far one soft mask is moved against another."""

from __future__ import annotations

import cv2
import numpy as np

from easyhecpp.camera import Camera

CAMERAS = {
    "focal lengths differ": Camera(240, 136, 170.0, 173.0, 113.0, 69.0),
    "plumb_bob": Camera(
        240, 136, 170.0, 170.0, 122.0, 69.0, "plumb_bob", (-0.25, 0.08, 1e-3, -2e-3)
    ),
    "fisheye": Camera(240, 136, 150.0, 150.0, 118.0, 71.0, "equidistant", (0.02, -0.01, 0.0, 0.0)),
}


def shift_px(picture: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(2,) how far a soft mask is moved against another; differences in blur do not count."""
    soft, truth = (cv2.GaussianBlur(a.astype(float), (0, 0), 1.5) for a in (picture, truth))
    down, right = np.gradient(truth)
    columns = [-right, -down, *np.gradient(right), np.gradient(down, axis=0)]
    matrix = np.stack([c.ravel() for c in columns], axis=1)
    return np.linalg.lstsq(matrix, (soft - truth).ravel(), rcond=None)[0][:2]
