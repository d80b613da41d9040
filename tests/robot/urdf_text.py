"""Pieces of URDF that several tests put together."""

from __future__ import annotations

BOX = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
LIMIT = '<limit lower="-1" upper="1"/>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = "") -> str:
    """A joint with limits -1..1 unless it is fixed or continuous."""
    limit = LIMIT if kind in ("revolute", "prismatic") else ""
    if "<limit" in inside:
        limit = ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{limit}{inside}</joint>"
    )
