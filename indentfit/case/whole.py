"""The whole case: its tables, its measured curves, and what follows from them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, InstanceOf, ValidationError, field_validator, model_validator

from indentfit.arrays import Array
from indentfit.case.curves import curve_files
from indentfit.case.families import faults_of_families
from indentfit.case.faults import (
    Parts,
    faults_across,
    faults_of_absence,
    faults_of_fibres,
    faults_of_parameters,
    faults_of_stiffness,
    faults_of_turn,
    labels,
    start_values,
)
from indentfit.case.field_faults import faults_of_fields
from indentfit.case.in_time import GRID, relaxation_of
from indentfit.case.laws import fibres_in, kept_by, law_of_choice, own_parameters, plugin_files
from indentfit.case.layers import OF_LAYERS, with_materials
from indentfit.case.messages import MISSING, Fault, Key, lines
from indentfit.case.quantities import Title
from indentfit.case.recording import Record
from indentfit.case.relaxation import Relaxation
from indentfit.case.search import Fit
from indentfit.case.section import raise_disagreements
from indentfit.case.specimen import OF_SPECIMENS, Specimen, axes_of, specimen_of
from indentfit.case.tables import Indenter, MaterialChoice, Mesh, Range, Sample, Solver, Test
from indentfit.case.unknown import with_priors
from indentfit.case.warnings import warnings_of
from indentfit.curve import Curve, require_loading
from indentfit.errors import CaseError, CurveError, MaterialError
from indentfit.fibres import Direction, Kept
from indentfit.material import Material


class Case(BaseModel):
    """A whole case: everything that a result depends on.

    Tables may be given as values or as plain dictionaries, tests and curves as lists or tuples.

    Attributes
    ----------
    tests, curves : tuple of Test, tuple of Curve or None
        `curves[i]` was measured in `tests[i]`; None where the test gives only a depth.
    path : path or None
        The case file; None for a case that was made from values.
    overrides : tuple of str
        KEY=VALUE that replaced keys of the file.

    Raises
    ------
    CaseError
        The error's text has one line for each fault.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_by_name=True, validate_by_alias=True, defer_build=True)

    title: Title = Field(default="", description="title of the case")
    sample: Sample = Field(default=Sample.untouched(), description="table of the sample; not where no test is an indentation")
    indenter: Indenter = Field(
        default=Indenter.untouched(), description="table of the indenter; not where no test is an indentation"
    )
    mesh: Mesh = Field(default=Mesh.untouched(), description="table of the mesh")
    material: MaterialChoice = Field(description="table of the material")
    tests: tuple[Test, ...] = Field(alias="test", min_length=1, description="list of tests")
    fit: Fit = Field(default=Fit.untouched(), description="table of the search")
    solver: Solver = Field(default=Solver.untouched(), description="table of the solver")
    record: Record = Field(default=Record.untouched(), description="table of how raw records are read")
    path: Path | None = Field(default=None, description="where the case was read; not a key of the file")
    overrides: tuple[str, ...] = Field(default=(), description="KEY=VALUE that replaced keys of the file")
    curves: tuple[InstanceOf[Curve] | None, ...] = ()

    def __init__(self, /, **keys: Any) -> None:
        try:
            super().__init__(**keys)
        except ValidationError as error:
            raise CaseError(lines(type(self), error)) from None

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # see Section

    @classmethod
    def of_parts(cls, parts: Parts, path: Path | None, overrides: Sequence[str]) -> Case:
        """The case of parts that were checked already."""
        values = {name: getattr(parts, name) for name in cls.model_fields if name not in ("path", "overrides")}
        values["tests"] = _weighted(values["tests"])
        return cls.model_construct(_fields_set=None, **values, path=path, overrides=tuple(overrides))

    @model_validator(mode="before")
    @classmethod
    def _curves_of_tests(cls, keys: Any) -> Any:
        """Curves in memory move from the tests into `curves`; a test keeps the name of the file that `case_toml` gives it."""
        if not isinstance(keys, dict):
            return keys
        sample = keys.get("sample")
        keys = with_materials(keys, sample.layer if isinstance(sample, Sample) else (sample or {}).get("layer") or ())
        if keys.get("curves"):
            return keys
        tests = keys.get("tests", keys.get("test", ()))
        if not isinstance(tests, list | tuple):
            return keys
        tests, curves = curve_files(tests)
        return {name: value for name, value in keys.items() if name != "test"} | {"tests": tests, "curves": curves}

    @model_validator(mode="after")
    def _give_priors(self) -> Case:
        """Inputs that are unknown or left out get a value and a prior."""
        tables = {name: getattr(self, name) for name in ("sample", "indenter", "material", "fit")}
        for name, table in with_priors(tables, self.indentations).items():
            object.__setattr__(self, name, table)
        return self

    @model_validator(mode="after")
    def _name_the_axes(self) -> Case:
        """Curves in memory need not say what they show: their tests do."""
        pairs = zip(self.tests, self.curves, strict=False)
        object.__setattr__(self, "curves", tuple(_shown(test, curve) for test, curve in pairs))
        return self

    @field_validator("tests")
    @classmethod
    def _share_the_weight(cls, tests: tuple[Test, ...]) -> tuple[Test, ...]:
        return _weighted(tests)

    @model_validator(mode="after")
    def _agree(self) -> Case:
        law = self._law_or_fault()
        raise_disagreements(type(self), faults_of_absence(self._parts(), self.model_fields_set))
        faults = list(faults_of_parameters(self.material, law)) or list(faults_of_stiffness(self.material, law))
        faults += [
            *faults_of_turn(self.fit, law),
            *faults_of_fibres(self.material, law, self.tests),
            *faults_of_families(self.material, law, self.sample, self._labelled),
            *self._faults_of_maps(),
            *faults_across(self._parts()),
            *faults_of_fields(self._parts()),
            *self._faults_of_curves(),
        ]
        raise_disagreements(type(self), faults)
        return self

    def _faults_of_maps(self) -> Iterator[Fault]:
        """Files of directions of fibres, which only a case that is read from a file opens."""
        tables: list[tuple[Key, Any]] = [(("sample",), self.sample)]
        tables += [(("test", label, "sample"), test.sample) for label, test in self._labelled]
        for key, table in tables:
            if table is not None and isinstance(table.directions, str):
                text = "a case in memory opens no file; give indentfit.fibre_map.read_fibre_map(file) in its place"
                yield Fault((*key, "directions"), table.directions, text)

    @property
    def _labelled(self) -> list[tuple[str, Test]]:
        return list(zip(labels([test.name for test in self.tests]), self.tests, strict=True))

    def _parts(self) -> Parts:
        return Parts(**{name: getattr(self, name) for name in Parts.__dataclass_fields__})

    def _faults_of_curves(self) -> list[Fault]:
        faults = []
        for label, test, curve in zip(labels([test.name for test in self.tests]), self.tests, self.curves, strict=True):
            key = ("test", label, "curve")
            if (test.curve is None and test.record is None) != (curve is None):
                text = "is the name of a file; read the case with read_case, or give a Curve"
                faults.append(Fault(key, test.curve or test.record or MISSING, text))
            elif curve is not None:
                try:
                    require_loading(curve)
                except CurveError as error:
                    faults.append(Fault(key, MISSING, str(error)))
        return faults

    def _law_or_fault(self) -> type[Material]:
        try:
            return self.law
        except MaterialError as error:
            if self.sample.layer:
                raise_disagreements(type(self), [Fault(OF_LAYERS, MISSING, str(error))])
            key = "model" if self.material.energy is None else "energy"
            raise_disagreements(type(self), [Fault(("material", key), getattr(self.material, key), str(error))])
            raise

    @property
    def law(self) -> type[Material]:
        """The class of the material; a file of the class that the case names is run. Raises MaterialError."""
        return law_of_choice(self.material, self.folder)

    @property
    def synthetic(self) -> tuple[str, ...]:
        """The names of the tests whose curves were computed and not measured."""
        return tuple(test.name for test in self.tests if test.synthetic)

    @property
    def indentations(self) -> tuple[Test, ...]:
        """The tests that are indentations."""
        return tuple(test for test in self.tests if test.kind == "indentation")

    @property
    def of_indentations(self) -> Case:
        """The case without tests that need no indenter; the case itself where there are none."""
        kept = [n for n, test in enumerate(self.tests) if test.kind == "indentation"]
        if len(kept) == len(self.tests):
            return self
        update = {"tests": tuple(self.tests[n] for n in kept), "curves": tuple(self.curves[n] for n in kept)}
        return self.model_copy(update=update)

    @property
    def without_fields(self) -> Case:
        """The case without the tests that stand for measured displacements (`field_tests.with_field_tests`)."""
        kept = [n for n, test in enumerate(self.tests) if test.kind != "field"]
        if len(kept) == len(self.tests):
            return self
        update = {"tests": tuple(self.tests[n] for n in kept), "curves": tuple(self.curves[n] for n in kept)}
        return self.model_copy(update=update)

    @property
    def of_forces(self) -> Case:
        """The case without measured displacements: of studies that ask for forces alone."""
        if not any(test.field for test in self.tests):
            return self
        case = self.without_fields
        return case.model_copy(update={"tests": tuple(test.model_copy(update={"field": ()}) for test in case.tests)})

    def specimen_of(self, test: Test) -> Specimen | None:
        """The specimen of a test without an indenter; None for an indentation."""
        return specimen_of(test)

    def sample_of(self, test: Test) -> Sample:
        """The sample of a test: the table [sample], with the test's own keys."""
        return test.sample.over(self.sample) if test.sample else self.sample

    def indenter_of(self, test: Test) -> Indenter:
        """The indenter of a test: the table [indenter], with the test's own keys."""
        return test.indenter.over(self.indenter) if test.indenter else self.indenter

    def fibres_of(self, test: Test) -> Direction:
        """The direction of the fibres in a test: as it says, turned by the sample's own angle."""
        turns = "fibre_angle" in self.fit.uncertain.fitted
        return fibres_in(self.material, self.law, self.sample_of(test), Direction(test.direction, test.dip, turns))

    def shares(self, table: str, key: str) -> bool:
        """Whether an indentation takes a key of [sample] or [indenter] from there, and has none of its own."""
        own = [getattr(test, table) for test in self.indentations]
        return any(keys is None or not keys.replaces(key, getattr(self, table)) for keys in own)

    @property
    def pieces(self) -> tuple[Case, ...]:
        """The case, parted into cases whose tests have the same sample and indenter and fibres that keep the same symmetry; the
        case itself where all have. Tests without an indenter are in none of them."""
        groups: list[tuple[tuple[Sample, Indenter, Kept], list[int]]] = []
        for n, test in enumerate(self.tests):
            if test.kind != "indentation":
                continue
            own = self.sample_of(test), self.indenter_of(test), kept_by(self.law, self.mesh, self.fibres_of(test))
            group = next((rows for known, rows in groups if known == own), None)
            if group is None:
                groups.append((own, [n]))
            else:
                group.append(n)
        if len(groups) == 1 and not any(test.sample or test.indenter or test.kind != "indentation" for test in self.tests):
            return (self,)
        return tuple(self._piece(sample, indenter, rows) for (sample, indenter, _), rows in groups)

    def _piece(self, sample: Sample, indenter: Indenter, rows: Sequence[int]) -> Case:
        tests = tuple(self.tests[n].model_copy(update={"sample": None, "indenter": None}) for n in rows)
        curves = tuple(self.curves[n] for n in rows)
        return self.model_copy(update={"sample": sample, "indenter": indenter, "tests": tests, "curves": curves})

    @property
    def folder(self) -> Path:
        """The folder that file names in the case are relative to."""
        return self.path.parent if self.path is not None else Path()

    @property
    def free(self) -> dict[str, Range]:
        """The parameters to be fitted, in the order of the law."""
        law = self.law
        given = own_parameters(self.material, law)
        values = {name: given[name] for name in law.parameters}
        return {name: value for name, value in values.items() if isinstance(value, Range)}

    @property
    def fitted(self) -> dict[str, Range]:
        """The parameters of a fit: the free parameters, the uncertain inputs that are to be fitted, and the free parameters of the
        relaxation."""
        return {**self.free, **self.fit.uncertain.fitted, **(self.relaxation.free if self.relaxation else {})}

    @property
    def relaxation(self) -> Relaxation | None:
        """The relaxation of the material, with the terms that the tool places; None where the material does not relax."""
        return relaxation_of(self)

    def start_values(self) -> dict[str, float]:
        """Every parameter in the order of the law: its fixed number, or the start of its search."""
        return start_values(self.material, self.law)

    def outputs(self, test: Test) -> Array:
        """Displacements at which the force of `test` is asked for, mm, shape (n,), rising: those of a measured curve, or where its
        times count a grid up to the deepest."""
        curve = self.curves[self.tests.index(test)]
        if curve is not None and curve.time is not None and self.material.relaxation is not None:
            return curve.deepest * np.arange(1, GRID + 1) / GRID
        if curve is not None:
            return curve.displacement
        assert test.largest is not None  # a test without a curve has a depth or a strain
        return test.largest * np.arange(1, test.points + 1) / test.points

    def points(self, test: Test) -> int:
        """Number of points of a test's measured curve, its hold among them, or of the one that is asked for."""
        curve = self.curves[self.tests.index(test)]
        return len(self.outputs(test)) if curve is None else int(curve.force.size)

    @property
    def hash(self) -> str:
        """SHA-256 of everything that a result depends on; titles, comments, paths and the number of workers do not change it."""
        if self.without_fields is not self:
            return self.without_fields.hash
        facts = self.model_dump(
            mode="json",
            exclude={"title": True, "path": True, "overrides": True, "curves": True, "record": True, "fit": {"workers"}},
        )
        for material in (facts["material"], *facts["sample"]["layer"]):
            if not material["shared"]:
                del material["shared"]
        if facts["sample"]["prestretch"] is None:
            del facts["sample"]["prestretch"]
        for layer in facts["sample"]["layer"]:
            if layer["interface"] == "bonded":
                del layer["interface"]
        if not facts["sample"]["layer"]:
            del facts["sample"]["layer"]
        if not facts["sample"]["fibre_angle"]:
            del facts["sample"]["fibre_angle"]
        for place in (facts["sample"], *(test["sample"] for test in facts["tests"] if test.get("sample"))):
            for key in ("families", "family_dips", "directions"):
                if place[key] is None:
                    del place[key]
        what_if = facts["fit"]["what_if"]
        facts["fit"]["what_if"] = "never" if what_if is False else bool(what_if)  # left out, it was false in 0.3.0
        if facts["fit"]["uncertain"]["fibre_angle"] is None:
            del facts["fit"]["uncertain"]["fibre_angle"]
        if not self.fit.prior.given:
            del facts["fit"]["prior"]
        if self.fit.discrepancy.stated is None:
            del facts["fit"]["discrepancy"]
        for own, test, curve in zip(self.tests, facts["tests"], self.curves, strict=True):
            del test["record"]  # the curve that the record became decides a result
            test["field"] = [{**known, "file": own.field[n].points.as_lists()} for n, known in enumerate(test["field"])]
            if not test["field"]:
                del test["field"]
            for key in ("sample", "indenter", "control", "force", *OF_SPECIMENS):
                if test[key] is None:
                    del test[key]
            if test["kind"] == "indentation":
                del test["kind"]
            if not test["dip"]:
                del test["dip"]
            for key in ("fibre_angle", "prestretch"):
                if test.get("sample") and test["sample"][key] is None:
                    del test["sample"][key]
            contact = [curve.contact] if curve is not None and curve.contact else []
            times = [curve.time.tolist()] if curve is not None and curve.time is not None and self.material.relaxation else []
            test["curve"] = curve and [*(column.tolist() for column in curve.columns), *times, *contact]
        for model, plugin in plugin_files(self.material, self.folder).items():  # the content of the file, not its place
            code = model.rpartition(":")[2] + " " + hashlib.sha256(plugin.read_bytes()).hexdigest()
            facts["material"]["model"] = facts["material"]["model"].replace(model, code)
            for layer in facts["sample"].get("layer", ()):
                layer["model"] = code if layer["model"] == model else layer["model"]
        return hashlib.sha256(json.dumps(facts, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

    def warnings(self) -> list[str]:
        """One line for each allowed but unusual value."""
        return list(warnings_of(self))


def _shown(test: Test, curve: Curve | None) -> Curve | None:
    """The curve of a test, which says what it shows."""
    known = curve is None or curve.axes is not None or test.kind == "indentation"
    return curve if known or curve is None else replace(curve, axes=axes_of(test))


def _weighted(tests: tuple[Test, ...]) -> tuple[Test, ...]:
    """The tests, each with its weight: by default 1 / number of tests."""
    share = 1 / len(tests)
    return tuple(test if test.weight is not None else test.model_copy(update={"weight": share}) for test in tests)
