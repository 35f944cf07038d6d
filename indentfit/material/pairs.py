"""Laws with two families of fibres of which some parameters are shared: the second family's value is that of the first."""

from functools import cache
from typing import Any

from indentfit.errors import MaterialError
from indentfit.material.model import Material
from indentfit.material.words import nearest

SECOND = "_second"  # behind the name of a parameter of the first family, it names that of the second


def sharing(law: type[Material], names: tuple[str, ...]) -> type[Material]:
    """A law whose second family has some parameters of the first.

    Parameters
    ----------
    law : class of Material
    names : tuple of str
        Parameters of the second family, such as "k2_second", which then are no parameters: their values are those of "k2".

    Returns
    -------
    class of Material
        The law itself where there are no names; within one process, the same law and names give the same class.

    Raises
    ------
    MaterialError
        A name is no parameter of a second family of the law.
    """
    if not names:
        return law
    able = [name for name in law.parameters if name.endswith(SECOND) and name.removesuffix(SECOND) in law.parameters]
    for name in names:
        if name not in able:
            has = f"those of {law.__name__} are {', '.join(able)}{nearest(name, able)}" if able else f"{law.__name__} has none"
            raise MaterialError(f"{name!r} is no parameter that two families can share; {has}")
    return _class_of(vars(law).get("_source", (law,)), tuple(sorted(set(names))))


@cache
def _class_of(source: tuple[Any, ...], names: tuple[str, ...]) -> type[Material]:
    """The class, of where a pickle finds its law: the class, or a function with its arguments."""
    law: type[Material] = source[0] if len(source) == 1 else source[0](*source[1:])
    fields = {name: _first(name.removesuffix(SECOND)) for name in names}
    own = {f"__{key}__": getattr(law, f"__{key}__") for key in ("doc", "module", "qualname")}
    return type(law.__name__, (law,), {**own, **fields, "_source": (_class_of, source, names)})


def _first(name: str) -> Any:
    """The first family's value, read as the second's; of a class it is the first's parameter."""

    class _Value:
        def __get__(self, material: Any, owner: type[Material]) -> Any:
            return owner.parameters[name] if material is None else material.__dict__[name]

        def __set__(self, material: Any, value: Any) -> None:
            raise AttributeError(f"the families share {name}")

    return _Value()
