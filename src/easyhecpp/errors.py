"""The errors that this package raises on purpose; anything else that escapes is a bug."""

from __future__ import annotations


class EasyHecError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(EasyHecError):
    """Something that the user gave (a file, an option, an array) cannot be used.

    The text says what is wrong, where, what was expected and how to mend it, so that the reader
    needs neither the traceback nor the source.

    Args:
        what: What is wrong, a sentence without its full stop.
        where: File, line, column or argument that it was found in.
        expected: What would have been right.
        fix: What the user can do about it.
    """

    def __init__(
        self,
        what: str,
        *,
        where: object = None,
        expected: str | None = None,
        fix: str | None = None,
    ) -> None:
        self.what = what
        self.where = None if where is None else str(where)
        self.expected = expected
        self.fix = fix
        parts = [_sentence(what if where is None else f"{_bare(what)} ({where})")]
        if expected is not None:
            parts.append(_sentence(f"Expected: {expected}"))
        if fix is not None:
            parts.append(_sentence(fix))
        super().__init__(" ".join(parts))

    def __reduce__(self) -> tuple[object, ...]:
        # The default would call __init__ with the joined text; worker processes send errors back
        # pickled.
        return (_rebuild_input_error, (type(self), self.what, self.where, self.expected, self.fix))


class NothingSuitsError(InputError):
    """All that was given can be read and used, but no answer was found that suits it.

    No joint pose that the camera sees, no view that shows the arm. A benchmark counts it as a
    failed scene; any other `InputError` there is a mistake that concerns all scenes.
    """


class MissingExtraError(EasyHecError, ImportError):
    """A feature was asked for whose optional package is not installed.

    Args:
        package: The package that cannot be imported.
        extra: The extra of easyhecpp that brings it.
        feature: What needs it, as the user would name it.
        reason: The importer's words, when the package is there but does not load.
    """

    def __init__(self, package: str, extra: str, feature: str, reason: str | None = None) -> None:
        self.package = package
        self.extra = extra
        self.feature = feature
        self.reason = reason
        state = "which is not installed" if reason is None else f"which does not load ({reason})"
        super().__init__(
            f"{feature} needs the package {package!r}, {state}. "
            f'Install it with: pip install "easyhecpp[{extra}]"'
        )

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.package, self.extra, self.feature, self.reason))


class CalibrationError(EasyHecError):
    """The input is well formed, but a computation on it cannot go on."""


def _rebuild_input_error(
    kind: type[InputError], what: str, where: str | None, expected: str | None, fix: str | None
) -> InputError:
    return kind(what, where=where, expected=expected, fix=fix)


def _bare(text: str) -> str:
    return text.rstrip().rstrip(".")


def _sentence(text: str) -> str:
    text = text.rstrip()
    return text if text.endswith((".", "!", "?")) else f"{text}."
