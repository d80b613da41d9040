"""Puts the tables of ``benchmarks/results`` into ``docs/results.md``.

    python benchmarks/results_page.py

Everything between the two marker lines of the page is replaced; the words around it are written by
hand. Tables come in the order of `ORDER`, any others after them by name.
"""

from __future__ import annotations

import re
from pathlib import Path

from easyhecpp._atomic import write_text

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PAGE = ROOT / "docs" / "results.md"

BEGIN = "<!-- tables: written by benchmarks/results_page.py -->"
END = "<!-- end of tables -->"

ORDER = (
    "eye_to_hand",
    "photo",
    "init",
    "explore",
    "targeting",
    "baxter",
    "marker",
    "adam",
    "prompts",
    "repeat",
    "real",
    "solve",
    "trust",
)
"""Beginnings of file names."""


def main() -> None:
    """Write the page anew."""
    page = with_tables(PAGE.read_text(encoding="utf-8"), tables(RESULTS, PAGE.parent))
    write_text(PAGE, page)
    print(f"written: {PAGE.relative_to(ROOT)}")


def tables(results: Path, page_folder: Path) -> str:
    """All tables, their pictures as seen from the folder of the page."""
    files = sorted(results.glob("*.md"), key=lambda path: (_place(path.stem), path.stem))
    return "\n\n".join(_from_page(path, page_folder) for path in files)


def with_tables(page: str, content: str) -> str:
    """The page with other content between its markers."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"{PAGE} lacks the lines {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{content}\n\n{END}{after}"


def _from_page(path: Path, page_folder: Path) -> str:
    folder = path.parent.relative_to(page_folder.parent).as_posix()
    text = path.read_text(encoding="utf-8").strip()
    return re.sub(r"(!\[[^\]]*\]\()([^)/]+\))", rf"\g<1>../{folder}/\g<2>", text)


def _place(stem: str) -> int:
    return next((i for i, name in enumerate(ORDER) if stem.startswith(name)), len(ORDER))


if __name__ == "__main__":
    main()
