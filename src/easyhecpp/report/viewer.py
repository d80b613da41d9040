"""A page with the arm, the camera and its uncertainty in 3-D, served to a browser by viser."""

from __future__ import annotations

import contextlib
import errno
import io
import socket
import threading
import webbrowser
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp._optional import require
from easyhecpp.capture import Capture, View
from easyhecpp.errors import InputError
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.geometry import quat_wxyz_from_matrix
from easyhecpp.report.uncertainty import SIGMAS_95, Uncertainty
from easyhecpp.report.wording import verdict_text

F64 = NDArray[np.float64]

_ARM = (206, 212, 222)
_BLUE = (33, 86, 209)
_IMAGE_WIDTH_PX = 960
_FACTORS = ("1", "10", "100", "1000")
# The ellipsoid is first shown at about this size, metres: at its own it would be a speck.
_FIRST_SIZE = 0.05


class PoseViewer:
    """Serves the page until it is stopped.

    The scene is in the robot's base frame, metres. A selector puts the arm (and a camera that rides
    on it) where it was in each view, with that view's picture in the camera's field of view.

    Args:
        result: A calibration with a pose.
        capture: The capture it was computed from, or another of the same robot and camera.
        host: Address to listen at; ``0.0.0.0`` lets other machines look too.
        port: Port to listen at.

    Raises:
        MissingExtraError: viser is not installed.
        InputError: The result has no pose or belongs to another robot or camera, or the port cannot
            be used.
    """

    def __init__(
        self, result: ResultFile, capture: Capture, *, host: str = "127.0.0.1", port: int = 8080
    ) -> None:
        viser = require("viser", "view", "The 3-D viewer")
        self._T_mount_cam = _pose_for(result, capture)
        _check_port(host, port)
        self._capture = capture
        with contextlib.redirect_stdout(io.StringIO()):  # it prints a banner all the same
            self._server: Any = viser.ViserServer(host=host, port=port, verbose=False)
        if self._server.get_port() != port:
            # Somebody took it in between, and viser went on to the next one without a word.
            self._server.stop()
            raise _port_in_use(host, port)
        self.url = f"http://{'localhost' if host in ('127.0.0.1', '0.0.0.0') else host}:{port}"
        self._stopped = threading.Event()
        self._links: list[Any] = []
        self._rider: Any = None
        self._frustum: Any = None
        self._ellipsoid: Any = None
        self._uncertainty = Uncertainty.of(result)
        self._build_scene()
        self._build_panel(result)
        self._stand_aside(capture.views[0])
        self.show(capture.views[0].id)

    def show(self, view_id: str) -> None:
        """Put everything where it was in a view.

        Raises:
            InputError: There is no such view.
        """
        view = self._capture.view(view_id)
        robot = self._capture.robot
        with self._server.atomic():
            for handle, T in zip(self._links, robot.link_poses(view.joints), strict=True):
                _place(handle, T)
            _place(self._rider, self._T_base_cam(view))
            self._frustum.image = _picture(view)

    def open_browser(self) -> None:
        """Open the page in the default browser.

        Raises:
            InputError: There is no browser that could be opened, for want of a display.
        """
        if not webbrowser.open(self.url):
            port = self.url.rsplit(":", 1)[1]
            raise InputError(
                "No browser can be opened here, as there is no display",
                where=self.url,
                expected="a desktop session",
                fix="Leave out --browser and open the address yourself; from another machine "
                f"first run: ssh -L {port}:localhost:{port} <this machine>",
            )

    def wait(self) -> None:
        """Return when the viewer has been stopped."""
        self._stopped.wait()

    def stop(self) -> None:
        """Stop serving."""
        self._server.stop()
        self._stopped.set()

    def _T_base_cam(self, view: View) -> F64:
        mount = self._capture.rig.mount
        return self._capture.robot.frame_pose(view.joints, mount) @ self._T_mount_cam

    def _build_scene(self) -> None:
        scene, robot, camera = self._server.scene, self._capture.robot, self._capture.camera
        scene.set_up_direction("+z")
        scene.add_grid("/floor", width=4.0, height=4.0, cell_size=0.25, section_size=1.0)
        scene.add_frame("/base", axes_length=0.2, axes_radius=0.004)
        scene.add_label("/base/name", robot.base_link)
        for name, mesh in zip(robot.link_names, robot.meshes, strict=True):
            self._links.append(
                scene.add_mesh_simple(
                    f"/arm/{name}",
                    mesh.vertices.astype(np.float32),
                    mesh.faces,
                    color=_ARM,
                    flat_shading=True,
                    side="double",
                )
            )
        distance = float(np.linalg.norm(self._T_mount_cam[:3, 3]))
        self._rider = scene.add_frame("/camera", axes_length=0.1, axes_radius=0.003)
        self._frustum = scene.add_camera_frustum(
            "/camera/frustum",
            fov=2.0 * float(np.arctan(0.5 * camera.height / camera.fy)),
            aspect=camera.width / camera.height,
            scale=0.16 * max(distance, 0.2),
            thickness=0.004,
            color=_BLUE,
            image=_picture(self._capture.views[0]),
            jpeg_quality=80,
            cast_shadow=False,
        )
        scene.add_label("/camera/name", camera.frame)
        if self._uncertainty is not None:
            _, R_cam_axes = np.linalg.eigh(self._uncertainty.camera)
            R_cam_axes[:, 0] *= np.linalg.det(R_cam_axes)
            self._ellipsoid = scene.add_icosphere(
                "/camera/ellipsoid",
                radius=1.0,
                color=_BLUE,
                opacity=0.4,
                wxyz=quat_wxyz_from_matrix(R_cam_axes),
                cast_shadow=False,
            )

    def _stand_aside(self, view: View) -> None:
        """Start beside the camera and a little behind it, so that its picture faces the viewer."""
        arm, camera = self._capture.robot.centre(view.joints), self._T_base_cam(view)[:3, 3]
        middle, apart = 0.5 * (arm + camera), camera - arm
        across = np.cross((0.0, 0.0, 1.0), apart)
        across /= max(float(np.linalg.norm(across)), 1e-6)
        span = float(np.linalg.norm(apart)) + 0.5 * self._capture.robot.reach
        start = self._server.initial_camera
        start.look_at = middle
        start.position = middle + 0.55 * apart + span * (0.8 * across + (0.0, 0.0, 0.4))

    def _build_panel(self, result: ResultFile) -> None:
        gui = self._server.gui
        text = verdict_text(result)
        lines = [f"### {text.word}", text.headline, *(f"- {line}" for line in text.why)]
        gui.add_markdown("\n\n".join(lines))
        chooser = gui.add_dropdown("view", options=self._capture.view_ids)
        chooser.on_update(lambda _: self.show(chooser.value))
        look = gui.add_button("Look through the camera")
        look.on_click(lambda event: self._look_through(event.client, chooser.value))
        if self._uncertainty is not None:
            longest = 1e-3 * float(self._uncertainty.half_axes_mm()[0])
            sizes = [abs(np.log(max(longest, 1e-9) * float(f) / _FIRST_SIZE)) for f in _FACTORS]
            first = _FACTORS[int(np.argmin(sizes))]
            factor = gui.add_dropdown("95 % ellipsoid, times", _FACTORS, initial_value=first)
            factor.on_update(lambda _: self._enlarge(float(factor.value)))
            self._enlarge(float(first))

    def _enlarge(self, factor: float) -> None:
        assert self._uncertainty is not None
        variances = np.maximum(np.linalg.eigvalsh(self._uncertainty.camera), 1e-18)
        self._ellipsoid.scale = tuple((SIGMAS_95 * factor * np.sqrt(variances)).tolist())

    def _look_through(self, client: Any, view_id: str) -> None:
        T = self._T_base_cam(self._capture.view(view_id))
        camera = self._capture.camera
        with client.atomic():
            client.camera.wxyz = quat_wxyz_from_matrix(T[:3, :3])
            client.camera.position = T[:3, 3]
            client.camera.fov = 2.0 * float(np.arctan(0.5 * camera.height / camera.fy))


def _pose_for(result: ResultFile, capture: Capture) -> F64:
    if result.T_mount_cam is None:
        raise InputError("The result holds no pose", expected="one that did not fail")
    if result.T_mount_cam.parent != capture.rig.mount:
        raise InputError(
            f"The result is the pose of a camera on '{result.T_mount_cam.parent}', the capture's "
            f"camera is on '{capture.rig.mount}'",
            where=capture.name,
            expected="a result and a capture of the same robot and set-up",
        )
    return result.T_mount_cam.array


def _place(handle: Any, T: F64) -> None:
    handle.wxyz = quat_wxyz_from_matrix(T[:3, :3])
    handle.position = T[:3, 3]


def _picture(view: View) -> NDArray[np.uint8] | None:
    image = view.image
    if image is None or image.shape[1] <= _IMAGE_WIDTH_PX:
        return image
    height = round(image.shape[0] * _IMAGE_WIDTH_PX / image.shape[1])
    return cv2.resize(image, (_IMAGE_WIDTH_PX, height), interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


def _check_port(host: str, port: int) -> None:
    """Refuse a port that cannot be had; viser itself would quietly take the next one."""
    if not 1 <= port <= 65535:
        raise InputError(f"There is no port {port}", expected="a number from 1024 to 65535")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(found[0], socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(found[4])
    except socket.gaierror as error:
        raise InputError(
            f"The address '{host}' is not known: {error.strerror}",
            expected="127.0.0.1 for this machine alone, 0.0.0.0 for others too",
        ) from error
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise _port_in_use(host, port) from error
        raise InputError(
            f"Cannot listen at port {port} of {host}: {error.strerror}",
            expected="an address of this machine and a port from 1024 to 65535",
        ) from error


def _port_in_use(host: str, port: int) -> InputError:
    return InputError(
        f"Port {port} is in use",
        where=host,
        expected="a port that no other program listens at, perhaps another viewer",
        fix="Stop the other program, or choose another port with --port",
    )
