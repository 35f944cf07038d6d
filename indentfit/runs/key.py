"""The key of a run: a hash of everything that decides its curve, so that no stored run answers for another.

The key covers sample, indenter, mesh, solver, the law with its code, bulk modulus, angle, output depths and parameters, the
sources of all modules that a run imports, and the versions of imported third-party packages. Measured forces, weights and settings
of the fit are not in the key: another fit of the same mechanics finds the same runs.
"""

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from indentfit.case import Case, Test
from indentfit.fem.linear.choice import choice
from indentfit.material import Layered, Material, laws_of
from indentfit.runs import closure
from indentfit.runs.mechanics import Indentation, Mechanics, mechanics_of

FORMAT = 1  # format of the ledger's rows
ALWAYS = ("mkl",)  # a library that pypardiso loads, and that no module imports


class Inputs:
    """The inputs that decide the curves of a case: `origin` is the hash of the inputs that are common to its runs."""

    def __init__(self, case: Case | Mechanics) -> None:
        mechanics = case if isinstance(case, Mechanics) else mechanics_of(case)
        self.tests = {test.name: test for test in mechanics.tests}
        self.own = {test.name: _own(mechanics, n) for n, test in enumerate(mechanics.tests)}
        self.versions = versions(mechanics.law)
        self.turns = mechanics.turns
        self.common = {
            "format": FORMAT,
            **_tables(mechanics),
            "mesh": mechanics.mesh.model_dump(mode="json"),
            "depth": mechanics.depth,  # the mesh is made for this depth
            "solver": {**mechanics.solver.model_dump(mode="json"), "linear": choice(mechanics.solver.linear)},
            "shapes": _shapes(mechanics),
            "material": _material(mechanics),
            "bulk_ratio": mechanics.material.bulk_over_shear,
            "kappa": mechanics.material.kappa,
            "relaxation": mechanics.material.relaxation and mechanics.material.relaxation.model_dump(mode="json"),
            "code": code(),
            "versions": self.versions,
        }
        self.origin = sha(as_json(self.common))

    def of(self, parameters: Mapping[str, Any], test: Test) -> dict[str, Any]:
        """The inputs of a run beyond the common ones: parameters (name -> value), of a test of the case."""
        known = self.tests[test.name]
        depths = np.asarray(known.depths, dtype=float).tolist()
        own = {**self.own[test.name], **_seen(known)}
        fibres = {**({"dip": test.dip} if test.dip else {}), **({"turns": True} if self.turns else {})}
        return {"parameters": dict(parameters), "angle": test.direction, **fibres, "depths": depths, "rate": known.rate, **own}

    def hash(self, inputs: Mapping[str, Any]) -> str:
        """SHA-256 of all that decides a run's curve."""
        return sha(self.origin + as_json(inputs))


def _seen(test: Indentation) -> dict[str, str]:
    """What a run brings beside its forces; nothing in most cases, whose runs then have the same key as before."""
    return {} if test.observed is None else {"observed": sha(test.observed.key + test.observed.depths.tobytes())}


def code() -> str:
    """Hash of the sources of all modules that a run imports: a version number does not change while the sources are edited."""
    return closure.of_runs().hash


def versions(law: type[Material]) -> dict[str, str | None]:
    """Versions of the third-party packages that a run of this law imports; None for a package that is not installed."""
    bases = [part for own in laws_of(law).values() for part in _of_bases(own)]
    first_names = {*closure.of_runs().foreign, *ALWAYS}.union(*(part.foreign for part in bases))
    known = {name: closure.version_of(name) for name in sorted(first_names)}
    return known | {"machine": platform.machine(), "system": platform.system()}


def _own(mechanics: Mechanics, test: int) -> dict[str, Any]:
    """What decides the curve of a test without an indenter, or of one in a case whose tests need several meshes; empty in other
    cases."""
    specimen = mechanics.tests[test].specimen
    if specimen is not None:
        return {"specimen": asdict(specimen)}
    if all(known.alike or known.specimen for known in mechanics.tests) and len(mechanics.kept) == 1:
        return {}
    own = mechanics.of(test)
    return {"own": {**_tables(own), "depth": own.depth, "shapes": _shapes(own)}}


def _tables(mechanics: Mechanics) -> dict[str, Any]:
    sample = mechanics.sample.model_dump(mode="json", exclude={"layer": {"__all__": {"parameters"}}})
    return {"sample": sample, "indenter": mechanics.indenter.model_dump(mode="json")}


def _shapes(mechanics: Mechanics) -> list[str]:
    """Hashes of the code of sample and indenter; none without indentations."""
    if all(test.specimen is not None for test in mechanics.tests):
        return []
    shapes = mechanics.sample.geometry, mechanics.indenter.geometry
    return [part.hash for shape in shapes for part in _of_bases(type(shape))]


def _material(mechanics: Mechanics) -> dict[str, Any]:
    """The material: its typed energy, or its name and the code of its class and base classes."""
    law = mechanics.law
    if issubclass(law, Layered):  # the table of the sample holds typed energies, and the bulk modulus of each layer
        return {name: [list(part.parameters), [known.hash for known in _of_bases(part)]] for name, part in law.laws.items()}
    if mechanics.material.energy is not None:
        return {"energy": mechanics.material.energy, "parameters": list(law.parameters)}
    return {"class": law.__qualname__, "parameters": list(law.parameters), "code": [part.hash for part in _of_bases(law)]}


def _of_bases(law: type) -> Iterable[closure.Closure]:
    """The closures of the files that define a law or a shape and its base classes, without those that every run imports."""
    modules = {base.__module__: base for base in law.__mro__[:-1] if base.__module__ not in closure.of_runs().sources}
    return [closure.of_law(base) for base in modules.values()]


def sha(content: str | bytes) -> str:
    """SHA-256 of a text or of bytes, in hexadecimal digits."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def as_json(value: Any) -> str:
    """A value as JSON with sorted keys and without spaces; numbers of NumPy as Python's own."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist()
