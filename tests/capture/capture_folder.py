"""A small valid capture on disk, to be broken by tests."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import yaml

# A lift, two revolute joints, an endless one, two fingers; the camera's link has no geometry.
URDF = """<?xml version="1.0"?>
<robot name="tiny">
  <link name="world"/>
  <link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link>
  <link name="carriage"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="upper"><visual><origin xyz="0 0 0.15"/>
    <geometry><box size="0.05 0.05 0.3"/></geometry></visual></link>
  <link name="lower"><visual><origin xyz="0.1 0 0"/>
    <geometry><box size="0.2 0.05 0.05"/></geometry></visual></link>
  <link name="hand"><visual><geometry><box size="0.05 0.1 0.02"/></geometry></visual></link>
  <link name="finger"><visual><geometry><box size="0.01 0.01 0.05"/></geometry></visual></link>
  <link name="camera_mount"/>
  <joint name="fixed_joint" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="0 0 0.05"/></joint>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="carriage"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.4" effort="1" velocity="1"/></joint>
  <joint name="joint1" type="revolute"><parent link="carriage"/><child link="upper"/>
    <origin xyz="0 0 0.05"/><axis xyz="0 0 1"/>
    <limit lower="-2.9" upper="2.9" effort="1" velocity="1"/></joint>
  <joint name="joint2" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="joint3" type="continuous"><parent link="lower"/><child link="hand"/>
    <origin xyz="0.2 0 0" rpy="0.3 0 0"/><axis xyz="1 0 0"/></joint>
  <joint name="finger_joint" type="prismatic"><parent link="hand"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
  <joint name="mount_joint" type="fixed"><parent link="hand"/><child link="camera_mount"/>
    <origin xyz="0.03 0 0.05" rpy="0 0.2 0"/></joint>
</robot>
"""

JOINTS = ("lift", "joint1", "joint2", "joint3")
WIDTH, HEIGHT = 64, 48


class CaptureFolder:
    """A small valid capture on disk, to be broken by a test."""

    def __init__(self, root: Path, views: tuple[str, ...] = ("0000", "0001", "0002")) -> None:
        self.root = root
        self.views = views
        rng = np.random.default_rng(3)
        (root / "robot").mkdir(parents=True)
        (root / "robot" / "robot.urdf").write_text(URDF)
        self.camera_info(self.topic_dump())
        self.positions = {
            view: dict(zip(JOINTS, rng.uniform(0.05, 0.35, len(JOINTS)), strict=True))
            for view in views
        }
        self.table()
        texture = rng.integers(40, 220, (HEIGHT, WIDTH, 3))
        for index, view in enumerate(views):
            left = 10 + 7 * index % 40
            image = texture.copy()
            image[10:30, left : left + 10] = (200, 120, 30)
            self.image(f"{view}.png", image.astype(np.uint8))
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            mask[10:30, left : left + 10] = 255
            self.image(f"{view}.png", mask, folder="masks")

    @staticmethod
    def topic_dump() -> dict:
        return {
            "height": HEIGHT,
            "width": WIDTH,
            "distortion_model": "plumb_bob",
            "d": [0.01, -0.02, 0.001, 0.002, 0.0],
            "k": [60.5, 0.0, 31.25, 0.0, 61.5, 24.75, 0.0, 0.0, 1.0],
            "frame_id": "optical",
        }

    def camera_info(self, entries: dict) -> None:
        (self.root / "camera_info.yaml").write_text(yaml.safe_dump(entries))

    def config(self, **settings: object) -> None:
        (self.root / "capture.yaml").write_text(yaml.safe_dump(settings))

    def table(
        self, header: list[str] | None = None, rows: list[list[object]] | None = None
    ) -> None:
        header = header or ["view", *JOINTS]
        if rows is None:
            rows = [
                [view, *(self.positions[view].get(name, 0.1) for name in header[1:])]
                for view in self.views
            ]
        with (self.root / "joints.csv").open("w", newline="") as file:
            csv.writer(file).writerows([header, *rows])

    def image(self, name: str, pixels: np.ndarray, folder: str = "images") -> Path:
        """Write pixels; colours are given as RGB or RGBA."""
        path = self.root / folder / name
        path.parent.mkdir(exist_ok=True)
        if pixels.ndim == 3 and pixels.shape[2] == 3:
            pixels = pixels[..., ::-1]
        elif pixels.ndim == 3 and pixels.shape[2] == 4:
            pixels = pixels[..., [2, 1, 0, 3]]
        assert cv2.imwrite(str(path), np.ascontiguousarray(pixels))
        return path

    def damage(self, name: str) -> Path:
        """Change bytes amid the pixels of a picture; size and header stay as they are."""
        path = self.root / name
        data = bytearray(path.read_bytes())
        middle = len(data) // 2
        data[middle : middle + 20] = bytes(20)
        path.write_bytes(data)
        return path
