"""Problems that pydantic finds, in words: where, what is wrong, what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest
from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tensionlab.errors import RigError
from tensionlab.support.validation import raises, validate


def _even(value: int) -> int:
    if value % 2:
        raise ValueError(f"{value} is odd; give an even number")
    return value


class Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    name: str = Field(min_length=1)
    anchor: list[float] = Field(description="where the cable leaves, in m")
    lower: float = Field(0.0, ge=0.0, description="smallest tension, in N")
    count: Annotated[int, AfterValidator(_even)] = 0


class Ball(BaseModel):
    model_config = ConfigDict(extra="forbid")
    kind: Literal["ball"]
    radius: float


class Whole(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    home: list[float]
    parts: list[Part] = Field([], max_length=2)
    shapes: list[Annotated[Ball | Part, Field(union_mode="left_to_right")]] = []
    counts: list[Annotated[int, Field(gt=0)]] = Field([1], min_length=1)
    tagged: dict[str, Annotated[Ball, Field()]] = {}
    share: float = Field(0.0, ge=0.0, le=1.0)
    rate: float = Field(1.0, gt=0.0, le=400.0)


GOOD: dict[str, Any] = {"home": [0.0], "parts": [{"name": "left", "anchor": [0.0, 1.0]}]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"home": "x"}, "home is 'x'; give a list"),
        ({"hom": 1}, "hom is an unknown key; did you mean 'home'?"),
        ({"zzz": 1}, "zzz is an unknown key; the keys here are home, parts, shapes, counts, tagged, share, rate"),
        ({"home": None}, "home is null; give a list"),
        ({"parts": [GOOD["parts"][0]] * 3}, "parts has 3 entries; give 2 at most"),
        ({"parts": [3]}, "parts[0] is 3; give a table of keys and values"),
        ({"parts": [{"name": "a"}]}, 'parts[0] ("a"): anchor is missing; give where the cable leaves, in m'),
        ({"parts": [{"name": "", "anchor": []}]}, "parts[0].name is ''; give a text that is not empty"),
        (
            {"parts": [{"name": "a", "anchor": [0.0, "b"]}]},
            "parts[0] (\"a\"): anchor[1] is 'b'; give a number (where the cable leaves, in m)",
        ),
        (
            {"parts": [{"name": "a", "anchor": [], "lower": -1.0}]},
            'parts[0] ("a"): lower is -1.0; give 0 or more (smallest tension, in N)',
        ),
        (
            {"parts": [{"name": "a", "anchor": [], "lowr": 1.0}]},
            "parts[0] (\"a\"): lowr is an unknown key; did you mean 'lower'?",
        ),
        (
            {"parts": [{"name": "a", "anchor": [], "count": 3}]},
            'parts[0] ("a"): count: 3 is odd; give an even number',
        ),
        ({"counts": [0]}, "counts[0] is 0; give more than 0"),
        ({"counts": []}, "counts has 0 entries; give 1 or more"),
        ({"share": 1.5}, "share is 1.5; give 0 to 1"),
        ({"rate": 0.0}, "rate is 0.0; give more than 0, up to 400"),
        (
            {"tagged": {"b": {"kind": "box", "radius": 1.0}}},
            "tagged.b.kind is 'box'; give 'ball'",
        ),
    ],
)
def test_a_problem_says_where_what_and_what_to_do(change: dict[str, Any], message: str) -> None:
    with pytest.raises(RigError) as caught:
        validate(Whole, GOOD | change, RigError, "rig.toml")
    assert str(caught.value) == f"rig.toml: {message}"


def test_good_values_become_the_object() -> None:
    assert validate(Whole, GOOD, RigError).parts[0].name == "left"


def test_several_problems_are_all_told_briefly() -> None:
    parts = [{"name": f"part {number}", "anchor": "x", "lower": -1.0} for number in range(2)]
    with pytest.raises(RigError) as caught:
        validate(Whole, {"home": 1, "parts": parts}, RigError)
    first, *lines = str(caught.value).splitlines()
    assert first == "5 problems:"
    assert lines[0] == "  home is 1"
    assert "part 1" in str(caught.value)
    parts = [{"name": "a" * 40, "anchr": []}] * 2
    with pytest.raises(RigError, match=r"and [0-9]+ more"):
        validate(Whole, GOOD | {"parts": parts, "x" * 40: 1}, RigError)


@pytest.mark.parametrize("decorate", [dataclass, pydantic_dataclass])
def test_dataclasses_are_documents_too(decorate: Any) -> None:
    @decorate
    class Spring:
        stiffness: Annotated[float, Field(gt=0.0, description="in N/m")] = 1.0

    with pytest.raises(RigError, match=r"^stiffness is 0.0; give more than 0 \(in N/m\)$"):
        validate(Spring, {"stiffness": 0.0}, RigError)
    assert validate(Spring, {}, RigError).stiffness == 1.0


def test_a_constructor_raises_the_error_of_its_room() -> None:
    @raises(RigError)
    @pydantic_dataclass(config=ConfigDict(extra="forbid"))
    class Spring:
        """Spring."""

        stiffness: Annotated[float, Field(gt=0.0)]

    assert Spring(2.0).stiffness == 2.0
    with pytest.raises(RigError, match=r"^\w+: stiffness is -1.0; give more than 0$"):
        Spring(-1.0)
    with pytest.raises(RigError, match=r"^\w+: stifness is an unknown key; did you mean 'stiffness'"):
        Spring(2.0, stifness=1.0)  # type: ignore[call-arg]
