"""Which files a capture folder holds for which view, against the rows of its table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from easyhecpp._paths import is_folder
from easyhecpp.capture._text import listing, plural
from easyhecpp.capture.config import CONFIG_NAME, CaptureConfig
from easyhecpp.capture.joint_table import JointTable
from easyhecpp.capture.pictures import list_pictures
from easyhecpp.capture.problems import Findings


@dataclass(frozen=True)
class PictureFiles:
    """The files of each kind by view id."""

    images: dict[str, Path]
    masks: dict[str, Path]
    depths: dict[str, Path]

    @staticmethod
    def find(root: Path, config: CaptureConfig, findings: Findings) -> PictureFiles:
        """List the folders of pictures; a capture without any is an error."""
        found: list[dict[str, Path]] = []
        for name, kind in (
            (config.images, "image"),
            (config.masks, "mask"),
            (config.depth, "depth image"),
        ):
            found.append({})
            with findings.catching():
                found[-1] = list_pictures(root / name, kind, findings)
        files = PictureFiles(*found)
        folder = root / config.images
        if any(problem.where == str(folder) for problem in findings.errors):
            return files  # why nothing was found is known
        if not files.images and files.masks:
            findings.note("There are no images, only masks", where=str(folder))
        elif not files.images:
            findings.error(
                "The folder of images holds no image"
                if is_folder(folder)
                else "There is no folder of images",
                where=str(folder),
                expected="PNG or JPEG files named like the views in joints.csv",
                fix=f"Put them there, or name the folder in {CONFIG_NAME}: 'images: FOLDER'",
            )
        return files

    @property
    def leading(self) -> dict[str, Path]:
        """The files that decide which views there are: the images, or else the masks."""
        return self.images or self.masks

    def match(self, table: JointTable, findings: Findings) -> None:
        """Report views that are only in the table or only among the pictures."""
        if not self.leading:
            return
        unseen = [view for view in table.views if view and view not in self.leading]
        unknown = [view for view in self.leading if view not in table.views]
        eaten = _without_zeros(unseen, unknown)
        if eaten:
            self._report_eaten_zeros(eaten, table, findings)
        unseen = [view for view in unseen if view not in eaten]
        unknown = [view for view in unknown if view not in eaten.values()]
        self._report_unmatched(unseen, unknown, table, findings)
        self._report_extras({*table.views, *self.leading}, findings)

    def _report_eaten_zeros(
        self, eaten: dict[str, str], table: JointTable, findings: Findings
    ) -> None:
        row, file = next(iter(eaten.items()))
        findings.error(
            f"Views in {table.path.name} lack the leading zeros of their files: {listing(eaten)}",
            where=str(table.path),
            expected=f"the files' names: '{row}' is '{file}'",
            fix="Restore the zeros; spreadsheets drop them unless the column is text",
            views=(*eaten, *eaten.values()),
            drops="view",
        )

    def _report_unmatched(
        self, unseen: list[str], unknown: list[str], table: JointTable, findings: Findings
    ) -> None:
        a_file, files = ("an image", "images") if self.images else ("a mask", "masks")
        name = table.path.name
        if unknown:
            findings.error(
                f"{plural(len(unknown), 'view')} with {a_file} but without a row in {name}: "
                f"{listing(unknown)}",
                where=str(table.path),
                expected="a row for every view",
                fix=f"Add the rows, or delete the {files}",
                views=tuple(unknown),
                drops="view",
            )
        if unseen:
            findings.error(
                f"{plural(len(unseen), 'view')} with a row in {name} but without {a_file}: "
                f"{listing(unseen)}",
                where=str(next(iter(self.leading.values())).parent),
                expected=f"{a_file} named like every row",
                fix=f"Add the {files}, or delete the rows",
                views=tuple(unseen),
                drops="view",
            )

    def _report_extras(self, views: set[str], findings: Findings) -> None:
        for files, kind in ((self.masks, "Mask"), (self.depths, "Depth image")):
            stray = [view for view in files if view not in views]
            if stray:
                findings.warn(
                    f"{kind} without a view: {listing(stray)}",
                    where=str(files[stray[0]].parent),
                    fix="Name it like its image, or delete it",
                )
        bare = [view for view in self.images if view not in self.masks]
        if self.masks and bare:
            findings.note(f"{plural(len(bare), 'view')} without a mask: {listing(bare)}")


def _without_zeros(rows: Iterable[str], files: Iterable[str]) -> dict[str, str]:
    """Rows that are files but for zeros in front, which spreadsheets eat; row to file."""
    stripped = {name.lstrip("0"): name for name in files}
    return {row: stripped[row.lstrip("0")] for row in rows if row.lstrip("0") in stripped}
