"""A deprecated name works and warns; none stays longer than it said."""

from __future__ import annotations

import ast
import warnings
from pathlib import Path

import pytest

import tensionlab as tl
from tensionlab.support.deprecation import deprecated

PACKAGE = Path(tl.__file__).parent


@deprecated(since="1.1", removed_in="2.0", instead="add(a, b)")
def plus(a: float, b: float = 1.0) -> float:
    """Return a sum."""
    return a + b


class Barrier:
    """Wall at a distance."""

    @deprecated(since="1.1", removed_in="2.0", instead="Wall")
    def __init__(self, distance: float) -> None:
        self.distance = distance

    @deprecated(since="1.2", removed_in="2.0", instead="distance")
    def far(self) -> float:
        """Return the distance."""
        return self.distance


def test_a_function_warns_at_the_line_that_calls_it() -> None:
    text = r"plus is deprecated since tensionlab 1\.1 and removed in 2\.0; use add\(a, b\)$"
    with pytest.warns(DeprecationWarning, match=text) as found:
        assert plus(1.0, b=2.0) == 3.0
    assert found[0].filename == __file__
    assert (plus.__name__, plus.__doc__) == ("plus", "Return a sum.")


def test_a_class_and_its_methods_warn_and_the_class_stays_one() -> None:
    with pytest.warns(DeprecationWarning, match="^Barrier is deprecated.*use Wall$") as found:
        barrier = Barrier(0.5)
    assert found[0].filename == __file__
    assert isinstance(barrier, Barrier)
    with pytest.warns(DeprecationWarning, match=r"^Barrier\.far is deprecated since tensionlab 1\.2"):
        assert barrier.far() == 0.5


def test_nothing_warns_before_it_is_called() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        deprecated(since="1.1", removed_in="2.0", instead="x")(lambda: None)


def overdue(text: str, version: str) -> list[str]:
    """Return what a module's text still has that should have been removed by a version."""
    found = []
    for node in ast.walk(ast.parse(text)):
        for mark in getattr(node, "decorator_list", ()):
            if isinstance(mark, ast.Call) and getattr(mark.func, "id", "") == "deprecated":
                words = {word.arg: ast.literal_eval(word.value) for word in mark.keywords}
                if numbers(words["removed_in"]) <= numbers(version):
                    found.append(node.name)  # type: ignore[attr-defined] - it has decorators
    return found


def numbers(version: str) -> list[int]:
    """Return the numbers of a version."""
    return [int(part) for part in version.split(".")]


def test_nothing_is_there_whose_time_has_come() -> None:
    own = Path(__file__).read_text(encoding="utf-8")
    assert overdue(own, "2.0.0") == ["plus", "__init__", "far"]
    assert overdue(own, "1.9.9") == []
    for path in sorted(PACKAGE.rglob("*.py")):
        assert not overdue(path.read_text(encoding="utf-8"), tl.__version__), path
