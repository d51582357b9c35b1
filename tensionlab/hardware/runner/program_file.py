"""What a program file may hold, as pydantic sees it; imported only when one is read."""

from __future__ import annotations

from pydantic import Field

from tensionlab.model.schema import Table


class StepTable(Table):
    """One ``[[steps]]`` entry."""

    seconds: float = Field(description="how long it takes in s, a number")
    wrench: list[float] = Field(description="what to render, a list of N, and of N·m after the forces")
    ramp: bool = Field(False, description="true or false: whether to go there evenly")
    brakes: list[str] = Field([], description="names of modules whose brake is on, a list")


class ProgramFile(Table):
    """A whole file."""

    name: str = Field(min_length=1, description="a name in quotes")
    repeat: bool = Field(False, description="true or false: whether to begin again at the end")
    steps: list[StepTable] = Field(min_length=1, description="at least one [[steps]] table")
