from __future__ import annotations

import numpy as np
import pytest

from easyhecpp.capture import check_capture
from easyhecpp.capture.health import FrameStatistics, health_findings


def scene(arm_at: int | None, *, gain: float = 1.0, noise: int = 0) -> np.ndarray:
    """A textured room with a white bar, seen with sensor noise."""
    room = np.random.default_rng(1).integers(30, 150, (240, 320, 3)).astype(float)
    if arm_at is not None:
        room[40:200, 4 * arm_at : 4 * arm_at + 48] = 220
    room = room * gain + np.random.default_rng(noise).normal(0, 2, room.shape)
    return room.clip(0, 255).astype(np.uint8)


def findings(*images: np.ndarray, joints: list[float] | None = None):
    joints = joints or [0.3 * i for i in range(len(images))]
    return health_findings(
        [
            FrameStatistics.of(f"{i:04d}", [q], image)
            for i, (image, q) in enumerate(zip(images, joints, strict=True))
        ]
    )


def moving(n: int = 5) -> list[np.ndarray]:
    return [scene(5 + 12 * i, noise=i) for i in range(n)]


def test_a_sound_recording_has_no_findings():
    assert findings(*moving()) == []


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (np.zeros((240, 320, 3), np.uint8), "Black images: 0005"),
        (np.full((240, 320, 3), 255, np.uint8), "Images of one colour all over: 0005"),
    ],
)
def test_blank_frames(image, text):
    found = findings(*moving(), image)
    assert [finding.text for finding in found] == [text]
    assert found[0].views == ("0005",)


def test_all_frames_identical():
    found = findings(*[scene(20)] * 4)
    assert [finding.text for finding in found] == ["All 4 images are identical"]


def test_an_arm_that_never_shows():
    found = findings(*[scene(None, noise=i) for i in range(4)])
    assert [finding.text for finding in found] == [
        "All 4 images show the same although the joints differ"
    ]


def test_still_arm_with_still_joints_is_sound():
    assert findings(*[scene(20, noise=i) for i in range(4)], joints=[0.5] * 4) == []


def test_a_camera_that_froze_for_a_moment():
    images = moving()
    images[3] = images[2]
    found = findings(*images)
    assert [f.text for f in found] == [
        "Identical images of different joint positions: 0002 and 0003"
    ]
    assert found[0].views == ("0002", "0003")
    assert findings(*images, joints=[0.0, 0.5, 1.0, 1.0, 1.5]) == []


@pytest.mark.parametrize(("gain", "word"), [(0.4, "darker"), (1.9, "brighter")])
def test_exposure_jumps(gain, word):
    images = moving()
    images[1] = scene(17, gain=gain, noise=1)
    assert [f.text for f in findings(*images)] == [f"Images much {word} than the others: 0001"]


def test_an_arm_over_a_third_of_the_picture_is_no_exposure_jump():
    images = moving()
    images[1][:, :120] = 250
    assert findings(*images) == []


def test_checking_a_folder_reports_them_as_warnings(folder):
    folder.image("0001.png", np.zeros((48, 64, 3), np.uint8))
    warnings = [p for p in check_capture(folder.root) if p.severity == "warning"]
    assert [(p.what, p.views) for p in warnings] == [("Black images: 0001", ("0001",))]
    assert "check exposure, lens cap" in warnings[0].fix
