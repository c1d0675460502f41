"""Everything that a user meets has a docstring with the sections that it needs; its examples run, doctests hold."""

import inspect
import re
import types
import typing
from collections.abc import Iterator
from typing import Any

import pytest

import glapp


def public() -> Iterator[tuple[str, Any]]:
    """Every class and function in `glapp.__all__` and in the `__all__` of its modules."""
    for name in glapp.__all__:
        thing = getattr(glapp, name)
        for inner in thing.__all__ if isinstance(thing, types.ModuleType) else ():
            yield f"{name}.{inner}", getattr(thing, inner)
        yield name, thing


CLASSES = dict(one for one in public() if inspect.isclass(one[1]))
FUNCTIONS = dict(one for one in public() if inspect.isfunction(one[1]))


def test_nothing_public_escapes() -> None:
    """A name that is neither class nor function is a module, a type to annotate with, or data."""
    rest = [thing for name, thing in public() if name not in CLASSES and name not in FUNCTIONS]
    assert all(isinstance(one, types.ModuleType | str | dict) or typing.get_origin(one) for one in rest)
    assert all(one.__doc__ for one in rest if isinstance(one, types.ModuleType))
    assert len(CLASSES) > 40 and len(FUNCTIONS) > 30


def sections(thing: Any) -> dict[str, str]:
    """The sections of a numpy docstring by their titles; the text before the first has the title ""."""
    parts = re.split(r"^([A-Z][a-z]+)\n-{3,}$", inspect.getdoc(thing) or "", flags=re.MULTILINE)
    return {"": parts[0]} | dict(zip(parts[1::2], parts[2::2], strict=True))


def described(section: str) -> set[str]:
    """The names at the margin of a section: `k, ti : float` describes two."""
    heads = re.findall(r"^(\S[^:\n]*)", section, flags=re.MULTILINE)
    return {name.strip(" *()") for head in heads for name in head.split(",")}


def parameters(thing: Any) -> set[str]:
    names = inspect.signature(thing).parameters.values()
    return {p.name for p in names if not p.name.startswith("_")}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions(name: str) -> None:
    function = FUNCTIONS[name]
    found = sections(function)
    assert found[""].strip()
    assert not parameters(function) - described(found.get("Parameters", ""))
    assert ">>>" in found.get("Examples", ""), "no example"
    returned = str(inspect.signature(function).return_annotation)
    explained = returned == "None" or any(name.split(".")[-1] in re.findall(r"\w+", returned) for name in CLASSES)
    assert explained or "Returns" in found, f"says nowhere what it returns ({returned})"


@pytest.mark.parametrize("name", CLASSES)
def test_classes(name: str) -> None:
    one = CLASSES[name]
    found = sections(one)
    assert found[""].strip()
    fields = set(getattr(one, "__members__", getattr(one, "model_fields", {})))
    fields = fields or set(getattr(one, "__dataclass_fields__", {}))
    fields = {field for field in fields or parameters(one) if not field.startswith("_")} - {"kind"}
    assert not fields - described(found.get("Parameters", "") + found.get("Attributes", ""))


@pytest.mark.parametrize("name", CLASSES)
def test_what_a_class_offers(name: str) -> None:
    own = {key: value for key, value in vars(CLASSES[name]).items() if not key.startswith(("_", "model_"))}
    fields = set(getattr(CLASSES[name], "__dataclass_fields__", ())) | set(getattr(CLASSES[name], "_fields", ()))
    assert not [key for key, value in own.items() if key not in fields and not (inspect.getdoc(value) or "").strip()]
