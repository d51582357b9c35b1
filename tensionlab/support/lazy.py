"""Names of a package that are imported where they are first used."""

from importlib import import_module

TYPE_CHECKING = False  # as in `typing`, which is not imported for it
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping


def importer(package: str, names: "Mapping[str, Iterable[str]]") -> "Callable[[str], object]":
    """Return the ``__getattr__`` of a package whose names are in these of its modules; it also imports modules."""
    homes = {name: module for module, those in names.items() for name in those}

    def find(name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        path = homes.get(name, f"{package}.{name}")
        try:
            module = import_module(path)
        except ModuleNotFoundError as error:
            if name in homes or error.name != path:
                raise
            raise AttributeError(f"module {package!r} has no attribute {name!r}") from None
        value = getattr(module, name) if name in homes else module
        setattr(import_module(package), name, value)
        return value

    return find
