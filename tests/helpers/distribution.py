"""A distribution as pip would leave it on the path: its modules, and the files that describe it."""

from pathlib import Path


def install(
    folder: Path, name: str, entries: dict[str, str], modules: dict[str, str], version: str = "1.0"
) -> None:
    """Put modules, and the entry points of the group `tensionlab.solvers`, into a folder of the path."""
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
    lines = ["[tensionlab.solvers]", *(f"{key} = {value}" for key, value in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text, encoding="utf-8")
