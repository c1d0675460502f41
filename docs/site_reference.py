"""Defaults and types in the tables of the reference, from the code.

Griffe gives all names of one row the default of the first, takes the first of the values in braces as the default, and
calls every field of a model of pydantic required.
"""

from typing import Any

from griffe import Class, DocstringSectionParameters, Extension, Function, Object


class Reference(Extension):
    """Each parameter of a docstring with the default that the code gives it, and with its type where it has none."""

    def on_package(self, *, pkg: Object, **_: Any) -> None:
        """Correct the docstrings of a package when all of it is loaded."""
        for one in pkg.members.values():
            if one.is_alias:
                continue
            if one.is_module:
                self.on_package(pkg=one)
            elif isinstance(one, Function | Class):
                _correct(one)


def _correct(of: Function | Class) -> None:
    for section in of.docstring.parsed if of.docstring else ():
        if isinstance(section, DocstringSectionParameters):
            for parameter in section.value:
                annotation, parameter.value = _known(of, parameter.name.lstrip("*"))
                parameter.annotation = parameter.annotation or annotation
    for one in of.members.values():
        if isinstance(one, Function):
            _correct(one)


def _known(of: Function | Class, name: str) -> tuple[Any, Any]:
    """Type and default as the code writes them; None for the default of a parameter that must be given."""
    if name in of.parameters:
        return of.parameters[name].annotation, of.parameters[name].default
    field = of.all_members.get(name) if isinstance(of, Class) else None
    return (field.annotation, field.value) if field is not None and field.is_attribute else (None, None)
