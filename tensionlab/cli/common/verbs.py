"""Parsing of all verbs' words, and the kinds of options. It imports little, for the sake of `estop`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup

from tensionlab.support.formatting import keep_together

ClickException: type[Any] = typer.BadParameter.__mro__[2]  # later versions of typer bring a click of their own
FORMATTER: Any = typer.Context.formatter_class
Function = TypeVar("Function", bound=Callable[..., Any])
EXAMPLES = {
    "--wrench": "1 2 3 (in N)",
    "--force": "1 2 3 (in N)",
    "--at": "0 -0.1 0.3 (in m)",
    "--rotation": "0 0 0.3 (in rad)",
    "--facing": "1 0 0",
    "--box": "-1 1 0 2 -1 1 (in m)",
    "--step": "0.1 (in m)",
    "--acceleration": "2 2 1 (in m/s²)",
}  # how the numbers of an option are written


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


class HelpFormatter(FORMATTER):  # type: ignore[misc]  # its class is not public
    """Writer of help whose lines end between words, without the types of arguments."""

    def write_text(self, text: str) -> None:
        """Write a paragraph."""
        write = super().write_text
        write(_keep_words(text))

    def write_dl(self, rows: Any, *widths: Any, **more: Any) -> None:
        """Write names with what they mean."""
        shown = [(re.sub(r" <(str|path|list\[\w+\])>$", "", name), _keep_words(text)) for name, text in rows]
        super().write_dl(shown, *widths, **more)

    def getvalue(self) -> str:
        """Return the help."""
        text: str = super().getvalue()
        return text.replace("\N{NO-BREAK SPACE}", " ").replace("\N{NON-BREAKING HYPHEN}", "-")


def _keep_words(text: str) -> str:
    return re.sub(r"(?<=\S)-(?=\S)", "\N{NON-BREAKING HYPHEN}", keep_together(text))


class HelpContext(typer.Context):
    """Context of a verb, which writes its help."""

    formatter_class = HelpFormatter


def refuse_repeats(verb: Any, context: Any, words: list[str]) -> None:
    """Refuse an option with one value that is there twice, of which the parser would keep the last."""
    try:
        _, _, parameters = verb.make_parser(context).parse_args(list(words))
    except ClickException as error:
        error.ctx = error.ctx or context
        raise
    for parameter, times in Counter[Any](parameters).items():
        if times == 1 or parameter.multiple or context.resilient_parsing:
            continue
        if not parameter.is_flag or parameter.secondary_opts:  # twice on is on
            raise typer.BadParameter("it is there twice; give it once", context, parameter)


class VerbGroup(TyperGroup):
    """Group of verbs, listed with all of their first lines."""

    context_class = HelpContext

    def parse_args(self, context: Any, words: list[str]) -> list[str]:
        """Read the words."""
        refuse_repeats(self, context, words)
        return super().parse_args(context, words)

    def format_commands(self, context: Any, formatter: Any) -> None:
        """Write the verbs."""
        verbs = ((name, self.get_command(context, name)) for name in self.list_commands(context))
        with formatter.section("Commands"):
            formatter.write_dl([(name, (verb.help or "").partition("\n")[0]) for name, verb in verbs if verb])


class Verb(TyperCommand):
    """Verb that refuses an option which is there twice, but for those that may be repeated."""

    context_class = HelpContext

    def parse_args(self, context: Any, words: list[str]) -> list[str]:
        """Read the words."""
        refuse_repeats(self, context, words)
        return super().parse_args(context, words)


class Verbs(typer.Typer):
    """Verbs, each a `Verb`."""

    def __init__(self, help_text: str | None = None) -> None:
        settings: dict[str, Any] = {"help": help_text, "no_args_is_help": True} if help_text else {}
        super().__init__(cls=VerbGroup, rich_markup_mode=None, **settings)

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Function], Function]:
        """Return what makes a function a verb."""
        return super().command(name, **{"cls": Verb, **settings})
