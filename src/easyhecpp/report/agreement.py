"""How well masks, pictures and pose agree, sorted for people: by link and view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from easyhecpp.formats.result_blocks import LinkAgreement, MaskResult


@dataclass(frozen=True)
class AgreementRow:
    """One link in all views.

    Attributes:
        link: Its name.
        cells: Its numbers by view; None where too little of it can be seen.
        overall: Mean score, each view weighing as much as it shows of the link's outline.
    """

    link: str
    cells: tuple[LinkAgreement | None, ...]
    overall: float


def agreement_table(masks: Sequence[MaskResult], names: Sequence[str]) -> list[AgreementRow]:
    """Agreement by link and view; links that no view shows are left out.

    Args:
        masks: Of all views.
        names: Links in the order wanted.
    """
    rows: list[AgreementRow] = []
    for name in names:
        cells = tuple(next((a for a in m.links if a.link == name), None) for m in masks)
        shown = [cell for cell in cells if cell is not None]
        length = sum(cell.length_px for cell in shown)
        if length > 0.0:
            overall = sum(cell.score * cell.length_px for cell in shown) / length
            rows.append(AgreementRow(name, cells, overall))
    return rows
