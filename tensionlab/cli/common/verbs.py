"""Parsing of all verbs' words, and the kinds of options. It imports little, for the sake of `estop`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

Function = TypeVar("Function", bound=Callable[..., Any])


def option(metavar: str, help_text: str, *names: str, **settings: Any) -> Any:
    """Return an option with a value."""
    return typer.Option(*names, metavar=metavar, help=help_text, **settings)


def flag(names: str, help_text: str, **settings: Any) -> Any:
    """Return an option without a value."""
    return typer.Option(names, help=help_text, **settings)


def port_option(help_text: str, *names: str, least: int = 0) -> Any:
    """Return an option that is a TCP or UDP port."""
    return option("PORT", help_text, *names, min=least, max=65535)


Json = Annotated[bool, flag("--json", "Print JSON instead of a table.")]


class Verb(TyperCommand):
    """Verb that refuses an option which is there twice, but for those that may be repeated."""

    def parse_args(self, context: Any, words: list[str]) -> list[str]:
        """Read the words; of an option with one value, the parser would keep the last without a word."""
        _, _, found = self.make_parser(context).parse_args(list(words))
        for each, times in Counter[Any](found).items():
            if times == 1 or each.multiple or context.resilient_parsing:
                continue
            if not each.is_flag or each.secondary_opts:  # twice on is on
                raise typer.BadParameter("it is there twice; give it once", context, each)
        return super().parse_args(context, words)


class Verbs(typer.Typer):
    """Verbs, each a `Verb`."""

    def __init__(self, help_text: str | None = None) -> None:
        super().__init__(help=help_text, no_args_is_help=bool(help_text), rich_markup_mode=None)

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Function], Function]:
        """Return what makes a function a verb."""
        return super().command(name, **{"cls": Verb, **settings})
