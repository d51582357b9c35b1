"""Names in docstrings: which are links, which are code, and which are wrong."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes

import tensionlab

ROOT = Path(__file__).parents[2]
# Libraries whose objects docstrings may name.
OTHERS = ("collections", "numpy", "xarray", "pandas", "matplotlib", "scipy", "docutils")


@cache
def house() -> frozenset[str]:
    """Return every name that the package knows: modules, classes, functions, constants, methods, fields."""
    names: set[str] = set()
    for found in pkgutil.walk_packages([str(Path(tensionlab.__file__).parent)], "tensionlab."):
        if found.name.endswith("__main__"):
            continue
        try:
            module = importlib.import_module(found.name)
        except ImportError:  # what needs a library that only tests have
            continue
        names.update((found.name, found.name.rpartition(".")[2]))
        for name, value in vars(module).items():
            names.add(name)
            if isinstance(value, type):
                fields = getattr(value, "__annotations__", {})
                names.update(f"{name}.{part}" for part in (*vars(value), *fields))
                names.update(fields)
                names.update(vars(value))
    return frozenset(names)


def known(target: str) -> bool:
    """Return whether a name in a docstring stands for something in the package, or in a library that it uses."""
    if target.partition(".")[0] in OTHERS or target in house():
        return True
    if target.endswith((".cpp", ".hpp", ".py")):
        return any(path.is_file() for path in (ROOT / "tensionlab").rglob(target.removeprefix("tensionlab/")))
    parts = target.removeprefix("tensionlab.").split(".")
    return parts[-1] in house() and (len(parts) == 1 or parts[-2] in house())


def resolve(app: Any, env: Any, node: Any, contnode: nodes.TextElement) -> nodes.TextElement | None:
    """Resolve a name that the reference does not list.

    A unique end of a listed name is a link to it; another name of the package is shown as code. What nobody knows
    stays unresolved, and Sphinx warns of it.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"].lstrip(".~")
    domain = env.domains["py"]
    end = target.removeprefix("tensionlab.")
    listed = [name for name in domain.objects if name.endswith(f".{end}")]
    if len(pages := {domain.objects[name].node_id: name for name in listed}) == 1:
        (name,) = pages.values()
        entry = domain.objects[name]
        uri = app.builder.get_relative_uri(node["refdoc"], entry.docname)
        link = nodes.reference("", "", contnode, internal=True, refuri=f"{uri}#{entry.node_id}", reftitle=name)
        return link
    return contnode if known(target) else None


def setup(app: Any) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
