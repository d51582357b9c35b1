"""The design page of a rig in a thread of this process: inline in a notebook, in a browser elsewhere."""

from __future__ import annotations

import atexit
import sys
from html import escape

from tensionlab.model.rig import Rig
from tensionlab.viewer.page import DesignPage
from tensionlab.viewer.server import PageServer

HEIGHT_PIXELS = 640
"""Of the page in a notebook."""


class RigPage:
    """Design page of a rig that this process serves; a notebook shows it where it is the value of a cell.

    Attributes
    ----------
    url : str
        Where browsers on this computer find it.

    Examples
    --------
    >>> import tensionlab as tl
    >>> page = tl.view(tl.load_rig("bartels2026-validation"))  # doctest: +SKIP
    >>> tl.save_rig(page.rig, "designed.toml")  # doctest: +SKIP
    """

    def __init__(self, rig: Rig) -> None:
        self._page = DesignPage(rig, PageServer())
        self.url = self._page.server.url
        atexit.register(self.close)  # before viser closes its server, and says so

    @property
    def rig(self) -> Rig:
        """The rig as it is designed now."""
        return self._page.state.rig

    def close(self) -> None:
        """Close the page; the rig stays as it was designed."""
        atexit.unregister(self.close)
        self._page.close()

    def __repr__(self) -> str:
        return f"<RigPage of {self.rig.name} at {self.url}>"

    def _repr_html_(self) -> str:
        return (
            f'<iframe src="{escape(self.url)}" style="width:100%;height:{HEIGHT_PIXELS}px;'
            f'border:1px solid rgba(128,128,128,.4)" title="{escape(self.rig.name)}"></iframe>'
        )


def view(rig: Rig) -> RigPage:
    """Open the design page of a rig: inline in a notebook, in a browser elsewhere.

    A thread serves it until it is closed or this process ends.

    Parameters
    ----------
    rig : Rig
        Rig to design.

    Returns
    -------
    RigPage
        With ``url``, ``rig`` (as it is designed now) and ``close()``.

    Raises
    ------
    MissingDependency
        If viser is not installed.

    Examples
    --------
    >>> import tensionlab as tl
    >>> page = tl.view(tl.load_rig("bartels2026-validation"))  # doctest: +SKIP
    >>> designed = page.rig  # doctest: +SKIP
    """
    page = RigPage(rig)
    if not in_notebook():
        page._page.server.open_browser()
    return page


def in_notebook() -> bool:
    """Tell whether this process computes for a notebook, which shows values of cells as HTML."""
    ipython = sys.modules.get("IPython")  # whatever a notebook runs in has imported it
    shell = None if ipython is None else ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None
