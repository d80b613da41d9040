"""Matrices for Python: JSON, .npz and .npy, with the names that robot-learning code uses."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from easyhecpp.formats._json_text import json_text
from easyhecpp.formats.exporters._pose import (
    BODY_AXES,
    GL_AXES,
    OPTICAL_AXES,
    T_CAM_CAMGL,
    Exporter,
    ExportPose,
    quat_wxyz,
    quat_xyzw,
)
from easyhecpp.geometry import inverse

_CONVENTIONS = {
    "naming": "T_a_b maps coordinates in frame b to frame a: p_a = T_a_b @ p_b; metres",
    "cam": OPTICAL_AXES,
    "quaternion": "quat_wxyz has the real part first",
    "extrinsic_cv": "3x4, world to camera, optical axes: p_cam = extrinsic_cv @ [p_world, 1]",
    "cam2world_gl": f"4x4, camera to world; the camera has {GL_AXES}",
    "intrinsic_cv": "3x3 in pixels, where an integer coordinate is the centre of a pixel (OpenCV); "
    "renderers that measure from the image's edge want 0.5 added to cx and cy",
    "world": "here the parent frame, which for eye-in-hand moves with the arm",
}


def _matrices(pose: ExportPose) -> dict[str, np.ndarray]:
    word = pose.mount_word
    return {
        f"T_{word}_cam": pose.T_parent_child,
        f"T_cam_{word}": pose.T_child_parent,
        "extrinsic_cv": pose.T_child_parent[:3],
        "cam2world_gl": pose.T_parent_child @ T_CAM_CAMGL,
        "intrinsic_cv": pose.camera.K,
    }


def _json(pose: ExportPose) -> dict[str, bytes]:
    camera = pose.camera
    content: dict[str, Any] = {
        "origin": list(pose.origin),
        "setup": pose.setup,
        "parent_frame": pose.parent,
        "child_frame": pose.child,
        "conventions": _CONVENTIONS,
        "xyz_m": (pose.T_parent_child[:3, 3] + 0.0).tolist(),
        "quat_wxyz": quat_wxyz(pose.T_parent_child).tolist(),
        **{name: (matrix + 0.0).tolist() for name, matrix in _matrices(pose).items()},
        "width": camera.width,
        "height": camera.height,
        "distortion_model": camera.distortion_model,
        "distortion": list(camera.distortion),
    }
    return {"": json_text(content).encode()}


def _npz(pose: ExportPose) -> dict[str, bytes]:
    camera = pose.camera
    arrays: dict[str, Any] = {
        **_matrices(pose),
        "width": camera.width,
        "height": camera.height,
        "distortion_model": camera.distortion_model,
        "distortion": np.array(camera.distortion, dtype=np.float64),
        "setup": pose.setup,
        "parent_frame": pose.parent,
        "child_frame": pose.child,
        "conventions": [f"{key}: {text}" for key, text in _CONVENTIONS.items()],
        "origin": pose.origin,
    }
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return {"": buffer.getvalue()}


def _npy(pose: ExportPose) -> dict[str, bytes]:
    buffer = io.BytesIO()
    np.save(buffer, pose.T_parent_child)
    # The format has no room for words, so they go into a file beside it.
    facts = pose.facts(f"T_{pose.mount_word}_cam = T_parent_child, 4x4 float64", None)
    return {"": buffer.getvalue(), ".txt": ("\n".join(facts) + "\n").encode()}


def _opengl(pose: ExportPose) -> dict[str, bytes]:
    T = pose.T_parent_child @ T_CAM_CAMGL
    content = {
        "origin": list(pose.origin),
        "setup": pose.setup,
        "parent_frame": pose.parent,
        "child_frame": pose.child,
        "conventions": {
            "camera": f"{GL_AXES}; it is the child frame turned half round its x axis",
            "cam2world_gl": "4x4, p_parent = cam2world_gl @ p_camera; metres",
            "world2cam_gl": "its inverse, the view matrix; written by rows, OpenGL wants columns",
            "quaternions": "of cam2world_gl",
            "not to be mixed up with": f"{OPTICAL_AXES}; {BODY_AXES}",
        },
        "cam2world_gl": (T + 0.0).tolist(),
        "world2cam_gl": (inverse(T) + 0.0).tolist(),
        "xyz_m": (T[:3, 3] + 0.0).tolist(),
        "quat_wxyz": quat_wxyz(T).tolist(),
        "quat_xyzw": quat_xyzw(T).tolist(),
    }
    return {"": json_text(content).encode()}


EXPORTERS = (
    Exporter(
        "json",
        "JSON with both directions, extrinsic_cv, cam2world_gl and intrinsic_cv",
        ".json",
        _json,
    ),
    Exporter("npz", "the same arrays as the JSON in a NumPy archive", ".npz", _npz),
    Exporter("npy", "the 4x4 pose alone, with a text file that says what it is", ".npy", _npy),
    Exporter(
        "opengl", "JSON with the pose and view matrix in OpenGL axes", ".opengl.json", _opengl
    ),
)
