"""Equations as MathML, which browsers draw by themselves: no script, no font to fetch."""

from __future__ import annotations

from html import escape
from typing import Any

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.util import logging


def mathml(latex: str, as_block: bool) -> str:
    r"""Return an equation in LaTeX as MathML, with the LaTeX as its alternative text.

    A block with ``\\`` or ``&`` has its lines aligned at the ``&``.

    Raises
    ------
    ValueError
        If the LaTeX cannot be read; `docutils` does not know every command.
    """
    aligned = as_block and ("&" in latex or r"\\" in latex) and r"\begin" not in latex
    text = rf"\begin{{aligned}}{latex}\end{{aligned}}" if aligned else latex
    drawn = str(latex2mathml.tex2mathml(text, as_block=as_block))
    return drawn.replace("<math", f'<math alttext="{escape(" ".join(latex.split()))}"', 1)


def _write(translator: Any, node: nodes.math | nodes.math_block, as_block: bool) -> str:
    try:
        return mathml(node.astext(), as_block)
    except (ValueError, SyntaxError) as error:
        logging.getLogger(__name__).warning("equation %r: %s", node.astext(), error, location=node)
        return f"<code>{translator.encode(node.astext())}</code>"


def visit_inline(translator: Any, node: nodes.math) -> None:
    """Write an equation within a line."""
    translator.body.append(_write(translator, node, as_block=False))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.math_block) -> None:
    """Write an equation on lines of its own, with its number if it has one."""
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    ids = "".join(f' id="{each}"' for each in node["ids"][:1])
    translator.body.append(f'<div class="math"{ids}>{number}{_write(translator, node, as_block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Offer the renderer to Sphinx as ``html_math_renderer = "mathml"``."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
