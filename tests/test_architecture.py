"""Keeps the layers of docs/architecture.md: imports point down, adapters stand alone."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import easyhecpp

SOURCE = Path(easyhecpp.__file__).parent

LAYERS = {
    0: {"_atomic", "_lens", "_optional", "_parallel", "_paths", "camera", "errors", "geometry"},
    1: {"capture", "rig", "robot"},
    2: {"render"},
    3: {"explore", "initialise", "segment", "solve"},
    4: {"drivers", "formats", "models", "planning", "sim", "store"},
    5: {"baselines", "bench", "report", "session"},
    6: {"__main__", "cli"},
}
LAYER_OF = {package: layer for layer, packages in LAYERS.items() for package in packages}

# Brought by extras, or slow to load: whoever imports the package must not pay for them.
EXTRAS = ("coal", "mitsuba", "onnxruntime", "pinocchio", "torch", "transformers", "viser")
HEAVY = (*EXTRAS, "cv2", "matplotlib", "numba", "numpy", "pydantic", "scipy", "trimesh")

PUBLIC = ("Camera", "Capture", "Robot", "calibrate")


def modules() -> Iterator[tuple[str, Path]]:
    """Every module below the top as its dotted name without `easyhecpp.`, and its file."""
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        if name:
            yield name, path


def imports_of(tree: ast.AST, name: str, is_package: bool) -> Iterator[tuple[str, int]]:
    """Absolute dotted names that a module imports, wherever in it, and the lines."""
    here = ["easyhecpp", *name.split(".")]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level + is_package] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            if origin == "easyhecpp":
                yield from ((f"easyhecpp.{alias.name}", node.lineno) for alias in node.names)
            else:
                yield origin, node.lineno


def own_imports() -> Iterator[tuple[str, str, str]]:
    """Who imports whom within the package: (importing package, imported package, place)."""
    for name, path in modules():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for imported, line in imports_of(tree, name, path.name == "__init__.py"):
            root, _, rest = imported.partition(".")
            if root == "easyhecpp":
                place = f"{path.relative_to(SOURCE)}:{line}"
                yield name.partition(".")[0], rest.partition(".")[0], place


def forbidden(importer: str, imported: str) -> str | None:
    """Say why one package may not import another, or nothing."""
    if importer == imported or imported == "__version__":
        return None
    if imported not in LAYER_OF:
        return f"imports easyhecpp.{imported}, which is in no layer; import it from its own module"
    above, here = LAYER_OF[imported], LAYER_OF[importer]
    if above > here:
        return f"imports upward, from layer {here} ({importer}) to layer {above} ({imported})"
    if above == here == 4:
        return f"an adapter ({importer}) imports another ({imported})"
    return None


def test_every_package_has_a_layer():
    unknown = sorted({name.partition(".")[0] for name, _ in modules()} - set(LAYER_OF))
    assert unknown == [], "give these a layer, here and in docs/architecture.md"


def test_imports_point_down():
    found = [
        f"{place} {reason}"
        for importer, imported, place in own_imports()
        if importer in LAYER_OF and (reason := forbidden(importer, imported))
    ]
    assert found == []


@pytest.mark.parametrize(
    ("importer", "imported", "words"),
    [
        ("render", "solve", "upward, from layer 2 (render) to layer 3 (solve)"),
        ("sim", "formats", "an adapter (sim) imports another (formats)"),
        ("session", "Capture", "in no layer"),
        ("solve", "render", None),
        ("session", "formats", None),
        ("sim", "sim", None),
    ],
)
def test_the_rule_itself(importer, imported, words):
    reason = forbidden(importer, imported)
    assert (reason is None) if words is None else (words in str(reason))


def test_no_two_packages_import_each_other():
    graph: dict[str, set[str]] = {}
    for importer, imported, _ in own_imports():
        if importer != imported and imported in LAYER_OF:
            graph.setdefault(importer, set()).add(imported)
    TopologicalSorter(graph).prepare()  # raises CycleError, which lists the circle


def test_layer_0_needs_little():
    # At import time; a function may load more when it is called.
    roots = {
        imported.partition(".")[0]
        for name, path in modules()
        if LAYER_OF.get(name) == 0
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for imported, _ in imports_of(node, name, is_package=False)
    }
    assert roots - set(sys.stdlib_module_names) - {"easyhecpp"} == {"numpy", "threadpoolctl"}


def test_the_library_prints_nothing():
    found = [
        f"{path.relative_to(SOURCE)}:{node.lineno}"
        for name, path in modules()
        if LAYER_OF.get(name.partition(".")[0]) != 6
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        if node.func.id == "print"
    ]
    assert found == []


def loaded_after(code: str, names: tuple[str, ...]) -> tuple[list[str], str]:
    """Run code in a fresh interpreter: which of `names` it loaded, and what it printed."""
    report = f"import sys; sys.stderr.write(' '.join(n for n in {names!r} if n in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True
    )
    return done.stderr.split(), done.stdout


def test_importing_the_package_loads_nothing_heavy_and_is_silent():
    assert loaded_after("import easyhecpp", HEAVY) == ([], "")


def test_the_core_does_not_load_what_extras_bring():
    core = sorted(
        name
        for name, _ in modules()
        if LAYER_OF.get(name.partition(".")[0], 9) <= 3 and "__main__" not in name
    )
    code = "import importlib\n" + "\n".join(
        f"importlib.import_module('easyhecpp.{name}')" for name in core
    )
    assert loaded_after(code, EXTRAS) == ([], "")


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_arrive_on_first_use(name):
    value = getattr(easyhecpp, name)
    assert value.__name__ == name
    assert value.__module__.startswith("easyhecpp.")
    assert getattr(easyhecpp, name) is value


def test_the_package_lists_its_public_names_and_knows_no_others():
    assert set(easyhecpp.__all__) == {*PUBLIC, "__version__"}
    assert set(PUBLIC) <= set(dir(easyhecpp))
    with pytest.raises(AttributeError, match="'easyhecpp' has no attribute 'Marker'"):
        _ = easyhecpp.Marker
