"""What ``tensionlab module calibrate`` found, as tables and as JSON."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from tensionlab.cli.common import output

if TYPE_CHECKING:
    from tensionlab.hardware.calibration.anchors import AnchorEstimate
    from tensionlab.hardware.calibration.gain import GainEstimate
    from tensionlab.model.rig import Rig


def gain_json(url: str, found: GainEstimate, *, written: bool) -> dict[str, object]:
    """What a gain is, in JSON."""
    numbers = {"newton_per_ampere": found.gain, "friction": found.friction, "zero": found.zero}
    return {
        "url": url,
        "newton_per_ampere_before": found.believed,
        **{name: None if each is None else vars(each) for name, each in numbers.items()},
        "error_before": found.before,
        "error_after": found.after,
        "balances": [vars(each) for each in found.balances],
        "written": written,
    }


def show_gain(url: str, found: GainEstimate) -> None:
    """What a gain is, as a table."""
    grid = output.table(f"{len(found.balances)} balances at {url}")
    for heading in ("", "before", "now", "95 % interval"):
        grid.add_column(heading, justify="left" if heading == "" else "right", no_wrap=True)
    rows = [("tension for each ampere, N/A", f"{found.believed:.4g}", found.gain, 4)]
    rows.append(("friction and cogging, N", "", found.friction, 3))
    if found.zero is not None:
        rows.append(("current that pulls nothing, A", "", found.zero, 4))
    for name, before, each, digits in rows:
        interval = f"{each.lower:.{digits}f} to {each.upper:.{digits}f}"
        grid.add_row(name, before, f"{each.value:.{digits}f}", interval)
    grid.add_row("error of tension (rms), N", f"{found.before:.3f}", f"{found.after:.3f}", "")
    output.console().print(grid)


def anchors_json(
    rig: Rig, found: AnchorEstimate, misfits: dict[str, float], out: Path | None, *, known: bool, offsets: bool
) -> dict[str, object]:
    """What anchors are, in JSON."""
    return {
        "rig": rig.name,
        "poses": len(found.residuals),
        "known": known,
        "freedom": found.freedom,
        "length_deviation": found.sigma,
        "misfit": misfits,
        "modules": [
            {
                "name": module.name,
                "nominal": module.anchor,
                "anchor": found.anchors[j],
                "deviation": found.deviations[j],
                "interval": found.intervals[j],
                "length_offset": found.offsets[j] if offsets else None,
            }
            for j, module in enumerate(rig.modules)
        ],
        "written": None if out is None else str(out),
    }


def show_anchors(
    rig: Rig, found: AnchorEstimate, misfits: dict[str, float], *, known: bool, offsets: bool
) -> None:
    """What anchors are, as a table."""
    import numpy as np

    poses = f"{len(found.residuals)} {'known' if known else 'unknown'} poses"
    grid = output.table(f"{rig.name}: anchors from {poses} (± 95 %)")
    grid.add_column("module")
    for axis in "xyz"[: rig.dimension]:
        grid.add_column(f"{axis}\nm", justify="right", no_wrap=True)
    for heading in ("moved\nmm", *(["length off\nmm"] if offsets else [])):
        grid.add_column(heading, justify="right", no_wrap=True)
    moved = np.linalg.norm(found.anchors - rig.anchors, axis=1)
    for j, module in enumerate(rig.modules):
        places = [
            f"{x:.4f} ± {'–' if math.isnan(w) else f'{w:.4f}'}"
            for x, w in zip(found.anchors[j], found.intervals[j], strict=True)
        ]
        extra = [f"{1e3 * found.offsets[j]:+.1f}"] if offsets else []
        grid.add_row(module.name, *places, f"{1e3 * moved[j]:.1f}", *extra)
    console = output.console()
    console.print(grid)
    before, after, held = (
        "–" if math.isnan(misfits[key]) else f"{1e3 * misfits[key]:.2f} mm"
        for key in ("before", "after", "held_out")
    )
    how = "rms" if known else "rms, beyond what the poses take up"
    console.print(
        f"\nLengths are off by {before} before, {after} now, and {held} at poses that were held out ({how}).",
        soft_wrap=True,
    )
    if not known:
        console.print("Where the rig stands and how it is turned is kept as in the rig file: lengths cannot tell.")
