"""indentfit: indentation records of soft tissue to material parameters with honest error bars, by inverse finite elements.

    import indentfit

    case = indentfit.read_case("case.toml")     # or indentfit.Case(sample=..., indenter=..., material=..., tests=[...])
    result = indentfit.fit(case)
    result.parameters["mu"].interval            # 95 %, in the parameter's unit

The public names are listed in `__init__.pyi`. Each is imported when it is first used, so that `import indentfit` is quick. Nothing
inside of the package imports from here.
"""

from typing import Any

import lazy_loader

_imported, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("indentfit")
    return _imported(name)
