"""The calibration report: one HTML file that needs no network.

Everything a reader needs to decide whether to trust the pose is in it, the verdict first. The
pictures are embedded as JPEG, the outlines and plots are SVG.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from easyhecpp._atomic import write_text
from easyhecpp.capture import Capture
from easyhecpp.formats.result_blocks import ViewResult
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.report.agreement import agreement_table
from easyhecpp.report.pictures import ViewPicture, view_pictures
from easyhecpp.report.plots import ellipsoid_panels
from easyhecpp.report.residuals import (
    all_views_histogram,
    axis_limit_px,
    contour_plot,
    link_table,
    mask_table,
    odd_links,
)
from easyhecpp.report.scene import scene_svg
from easyhecpp.report.templating import template
from easyhecpp.report.uncertainty import Uncertainty
from easyhecpp.report.wording import flag_text, verdict_text
from easyhecpp.solve import ContourFit, PoseEstimate

# A view whose weight is below this share of the typical one counts as "partly used".
_LOW_WEIGHT = 0.6


@dataclass(frozen=True)
class ViewCard:
    """One view in the report.

    Attributes:
        id: Its name.
        status: ``used``, ``partly used``, ``left out`` or ``no mask``; "" without a pose.
        fit: Its entry in the result, None when it took no part at all.
        flags: Findings, in words.
        notes: What was said of its mask, sentences.
        picture: Picture and outlines.
        plot: Displacement along the contour, SVG.
    """

    id: str
    status: str
    fit: ViewResult | None
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    picture: ViewPicture
    plot: Markup


def write_report(
    path: str | os.PathLike[str],
    result: ResultFile,
    capture: Capture,
    estimate: PoseEstimate | None = None,
    masks: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write ``report.html``, whole or not at all.

    Args:
        path: The file.
        result: The calibration's outcome; it may have failed, and may lack a pose.
        capture: What it was computed from.
        estimate: The optimiser's account, for the residual plots; they are left out without it.
        masks: The masks used, by view id; bool, or float in [0, 1].

    Raises:
        InputError: A picture cannot be read, or the file cannot be written.
    """
    write_text(path, report_html(result, capture, estimate, masks))


def report_html(
    result: ResultFile,
    capture: Capture,
    estimate: PoseEstimate | None = None,
    masks: Mapping[str, NDArray[Any]] | None = None,
) -> str:
    """The report's text; see `write_report`."""
    T = None if result.T_mount_cam is None else result.T_mount_cam.array
    if T is None:
        estimate = None
    hard = {view_id: np.asarray(mask) > 0.5 for view_id, mask in (masks or {}).items()}
    limit = 0.0 if estimate is None else axis_limit_px(estimate)
    fits = _fits(estimate)
    names = capture.robot.link_names
    cards = [
        _card(result, picture, picture.id in hard, fits.get(picture.id), names, limit)
        for picture in view_pictures(capture, T, hard)
    ]
    links = [] if estimate is None else link_table(estimate, names)
    # Of a failed pose the uncertainty says nothing, and small numbers would mislead.
    uncertainty = None if result.verdict == "failed" else Uncertainty.of(result)
    shown = next((v for v in capture.views if _weight(result, v.id) > 0), capture.views[0])
    scene, scene_note = "", ""
    if T is not None:
        covariance = None if uncertainty is None else uncertainty.camera
        scene, scene_note = scene_svg(capture, shown.joints, T, covariance)
    return template("report.html.j2").render(
        result=result,
        capture=capture,
        text=verdict_text(result),
        cards=cards,
        used=[card for card in cards if card.status in ("used", "partly used")],
        T=result.T_mount_cam,
        uncertainty=uncertainty,
        mm_per_px=_mm_per_px(result, uncertainty),
        scene=Markup(scene),
        scene_note=scene_note,
        scene_view=shown.id,
        ellipsoids=Markup("" if uncertainty is None else ellipsoid_panels(uncertainty)),
        histogram=Markup("" if estimate is None else all_views_histogram(estimate, limit)),
        dilation_px=None if estimate is None else estimate.dilation_px,
        links=links,
        agreement=agreement_table(result.masks, names),
        odd_links=[] if estimate is None else odd_links(mask_table(estimate, hard, names)),
        link_views=() if estimate is None else tuple(view.id for view in estimate.views),
        limit_px=limit,
        size=(capture.camera.width, capture.camera.height),
    )


def _fits(estimate: PoseEstimate | None) -> dict[str, ContourFit]:
    if estimate is None:
        return {}
    return {
        view.id: contour for view, contour in zip(estimate.views, estimate.contours, strict=True)
    }


def _weight(result: ResultFile, view_id: str) -> float:
    return next((view.weight for view in result.views if view.id == view_id), 0.0)


def _card(
    result: ResultFile,
    picture: ViewPicture,
    has_mask: bool,
    contour: ContourFit | None,
    names: tuple[str, ...],
    limit_px: float,
) -> ViewCard:
    fit = next((view for view in result.views if view.id == picture.id), None)
    plot = "" if contour is None else contour_plot(contour, picture.lines, names, limit_px)
    return ViewCard(
        id=picture.id,
        status=_status(result, fit, has_mask),
        fit=fit,
        flags=() if fit is None else tuple(flag_text(flag) for flag in fit.flags),
        notes=next((mask.notes for mask in result.masks if mask.id == picture.id), ()),
        picture=picture,
        plot=Markup(plot),
    )


def _status(result: ResultFile, fit: ViewResult | None, has_mask: bool) -> str:
    if fit is None and not has_mask:
        return "no mask"
    if result.T_mount_cam is None:
        return ""
    if fit is None or fit.weight == 0:
        return "left out"
    typical = float(np.median([view.weight for view in result.views if view.weight > 0]))
    return "used" if fit.weight >= _LOW_WEIGHT * typical else "partly used"


def _mm_per_px(result: ResultFile, uncertainty: Uncertainty | None) -> float | None:
    if uncertainty is None or uncertainty.distance is None or uncertainty.distance <= 0:
        return None
    return 1e3 * uncertainty.distance / result.camera.fx
