"""Small helpers for sentences that name files, views and joints."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


def listing(items: Iterable[object], limit: int = 8) -> str:
    """Joins names with commas; beyond `limit` names the rest is counted, not shown."""
    names = [str(item) for item in items]
    if not names:
        return "none"
    if len(names) <= limit:
        return ", ".join(names)
    return ", ".join(names[:limit]) + f" and {len(names) - limit} more"


def plural(count: int, noun: str) -> str:
    """`1 view`, `3 views`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def closest(name: str, known: Sequence[str], cutoff: float = 0.6) -> str | None:
    """The known name that `name` was probably meant to be, or None."""
    folded = {candidate.lower(): candidate for candidate in known}
    matches = difflib.get_close_matches(name.lower(), list(folded), n=1, cutoff=cutoff)
    return folded[matches[0]] if matches else None


def did_you_mean(name: str, known: Sequence[str]) -> str | None:
    """A question to show as the fix of a misspelt name, or None when nothing is near."""
    near = closest(name, known)
    return f"Did you mean '{near}'?" if near else None
