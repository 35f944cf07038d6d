"""Mechanics: the part of a case that decides its curves. A run receives nothing else, and its key covers all of it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case.in_time import motion_of
from indentfit.case.laws import fibres_in, kept_by, law_of_choice
from indentfit.case.measured_field import half_width, known_points
from indentfit.case.specimen import Specimen
from indentfit.case.tables import Indenter, MaterialChoice, Mesh, OwnIndenter, OwnSample, Sample, Solver
from indentfit.displacements import Displacements, shares_of
from indentfit.fem.meshing import resized
from indentfit.fem.observation import Observed
from indentfit.fem.setup import InTime, Setup
from indentfit.fem.wide_block import setup_for
from indentfit.fibres import Direction, Kept
from indentfit.material import Material
from indentfit.outlines import Trace, beyond, chain
from indentfit.samples import inside

if TYPE_CHECKING:
    from indentfit.case import Case, Test

WIDER = "mesh.wider"  # key of a point: the factor by which all elements are wider than those of the case's mesh
OF_SIZE = ("size", "elements")  # keys of a mesh that exclude each other


@dataclass(frozen=True, eq=False)
class Indentation:
    """One test, mostly an indentation, without its measured forces and weight.

    Parameters
    ----------
    name : str
    angle, dip : float, degrees
        Direction of the fibres, as the test states it.
    depths : array (n,), mm
        Displacements at which the force is computed.
    rate : float, mm/s, or None
        Velocity of the indenter; None where the material does not relax.
    sample, indenter : OwnSample, OwnIndenter or None
        Keys in which sample and indenter of the test are its own.
    specimen : Specimen or None
        What is loaded in a test without an indenter; its depths are displacements of that.
    observed : Observed or None
        Displacements that the run brings beside the forces.
    """

    name: str
    angle: float
    depths: Array
    rate: float | None = None
    sample: OwnSample | None = None
    indenter: OwnIndenter | None = None
    specimen: Specimen | None = None
    dip: float = 0.0
    observed: Observed | None = None

    @property
    def alike(self) -> bool:
        """Whether the test is an indentation of the case's own sample by its own indenter."""
        return not (self.sample or self.indenter or self.specimen)

    def in_time(self, material: MaterialChoice) -> InTime | None:
        """The rate with the relaxation of the material; None where the test has no rate."""
        return InTime(self.rate, material.relaxation) if self.rate is not None and material.relaxation is not None else None


@dataclass(frozen=True, eq=False)
class Mechanics:
    """The tables of a case that decide its curves, and its tests.

    Parameters
    ----------
    sample, indenter, mesh, solver, material : tables of the case
    folder : path
        The folder to which the name of a law's file is relative.
    tests : tuple of Indentation
    wider : float
        The factor by which elements are wider than `mesh` says.
    turns : bool
        Whether a fit turns the fibres.
    """

    sample: Sample
    indenter: Indenter
    mesh: Mesh
    solver: Solver
    material: MaterialChoice
    folder: Path
    tests: tuple[Indentation, ...]
    wider: float = 1.0
    turns: bool = False

    @property
    def law(self) -> type[Material]:
        """The class of the material; a file of the class that the case names is run. Raises MaterialError."""
        return law_of_choice(self.material, self.folder)

    def of(self, test: int) -> "Mechanics":
        """The mechanics of those tests that have the same sample and indenter as one of them, in the tables of which these are, and
        fibres that keep the same symmetry; a test without an indenter is alone."""
        if all(known.alike for known in self.tests) and len(self.kept) == 1:
            return self
        if self.tests[test].specimen is not None:
            return replace(self, tests=(self.tests[test],))
        sample, indenter, kept = self._common(self.tests[test])
        indentations = [known for known in self.tests if known.specimen is None]
        same = [known for known in indentations if self._common(known) == (sample, indenter, kept)]
        tests = tuple(replace(known, sample=None, indenter=None) for known in same)
        return replace(self, sample=sample, indenter=indenter, tests=tests)

    def _common(self, test: Indentation) -> tuple[Sample, Indenter, Kept]:
        """What tests on one mesh have in common."""
        sample = test.sample.over(self.sample) if test.sample else self.sample
        indenter = test.indenter.over(self.indenter) if test.indenter else self.indenter
        return sample, indenter, kept_by(self.law, self.mesh, self.fibres(test))

    def fibres(self, test: Indentation) -> Direction:
        """The direction of the fibres in a test, turned by its sample's own angle."""
        sample = test.sample.over(self.sample) if test.sample else self.sample
        return fibres_in(self.material, self.law, sample, Direction(test.angle, test.dip, self.turns))

    @property
    def kept(self) -> set[Kept]:
        """The symmetries that the fibres of the indentations keep, one by one."""
        return {kept_by(self.law, self.mesh, self.fibres(test)) for test in self.tests if test.specimen is None}

    @property
    def depth(self) -> float:
        """The largest depth of the indentations, mm, for which the mesh is made; 0 without any."""
        return max((float(test.depths[-1]) for test in self.tests if test.specimen is None), default=0.0)

    @property
    def setup(self) -> Setup:
        """The Setup of the mesh, for the deepest of the tests. Raises MeshError."""
        shaped = any(test.observed is not None for test in self.tests)
        setup = setup_for(self.sample, self.indenter, self.mesh, self.solver, self.law, self.depth, self.kept, shaped)
        return setup if self.wider == 1 else resized(setup, self.wider)

    def changed(self, changes: dict[str, Any]) -> "Mechanics":
        """The mechanics with other values of keys ("table.key" -> value)."""
        mechanics = self
        for whole, value in changes.items():
            if whole == WIDER:
                mechanics = replace(mechanics, wider=value)
                continue
            name, key = whole.split(".")
            mechanics = replace(mechanics, **{name: with_key(getattr(mechanics, name), key, value)})
        return mechanics


def indentation_of(case: "Case", test: "Test") -> Indentation:
    """The Indentation of a test of a case."""
    depths = case.outputs(test)
    own = test.sample, test.indenter, case.specimen_of(test)
    return Indentation(test.name, test.direction, depths, _rate(case, test), *own, test.dip, observed_of(case, test))


def observed_of(case: "Case", test: "Test") -> Observed | None:
    """The displacements that were measured in a test of a case; None where none were."""
    sample, parts = case.sample_of(test), []
    for points in _points_of(case, test):
        if points.across is not None:
            parts.append(_outline_seen(points, half_width(points, sample.geometry.outline), float(sample.thickness)))
            continue
        groups, thickness = points.groups, float(sample.thickness)
        places = inside(points.points, sample.geometry.outline, thickness) / [1.0, thickness, 1.0]
        depths = np.bincount(groups, points.depths) / np.bincount(groups)
        parts.append(Observed(places, points.directions, groups, shares_of(points, groups), depths))
    return Observed.together(parts) if parts else None


def _outline_seen(points: Displacements, half: float, thickness: float) -> Observed:
    """The displacements of the points of an outline, once for each picture, and what makes distances of them."""
    assert points.places is not None and points.across is not None  # it was put on the sample
    nodes, along = chain(half, thickness), points.section
    depths, pictures = np.unique(points.depths, return_inverse=True)
    number = 2 * len(nodes)
    places, directions = np.zeros((number, 3)), np.zeros((number, 3))
    places[:, along] = np.repeat(nodes / [1.0, thickness], 2, axis=0)
    directions[::2, along[0]], directions[1::2, along[1]] = 1.0, 1.0
    groups = points.groups
    starts = -beyond(points.places[:, along], nodes)
    trace = Trace(nodes, points.places[:, along], pictures.ravel(), starts, groups, shares_of(points, groups))
    whole = Observed.single(np.tile(places, (depths.size, 1)), np.tile(directions, (depths.size, 1)), np.repeat(depths, number))
    return replace(whole, pieces=((number * depths.size, trace),))


def sizes_of_fields(case: "Case", test: "Test") -> list[int]:
    """The number of displacements that a fit counts with, of each field of a test."""
    return [int(points.groups.max()) + 1 for points in _points_of(case, test)]


def _points_of(case: "Case", test: "Test") -> list[Displacements]:
    if not test.field:
        return []
    sample = case.sample_of(test)
    return known_points(test.field, float(case.outputs(test)[-1]), sample.geometry.outline, float(sample.thickness))


def _rate(case: "Case", test: "Test") -> float | None:
    """Velocity of the indenter in the ramp of a test, mm/s; None where the material does not relax, or the rig holds the force."""
    if case.material.relaxation is None or test.control == "force":
        return None
    known = motion_of(test, case.curves[case.tests.index(test)])
    return known[0].ramp.depth / known[0].ramp.seconds if known is not None else None


def mechanics_of(case: "Case") -> Mechanics:
    """The Mechanics of a case."""
    case = case.without_fields
    tests = tuple(indentation_of(case, test) for test in case.tests)
    turns = "fibre_angle" in case.fit.uncertain.fitted
    return Mechanics(case.sample, case.indenter, case.mesh, case.solver, material_of(case), case.folder, tests, turns=turns)


def material_of(case: "Case") -> MaterialChoice:
    """The material of a case; free parameters of its relaxation have their start values."""
    relaxation = case.relaxation
    return case.material if relaxation is None else case.material.model_copy(update={"relaxation": relaxation.at({})})


def with_key(table: Any, key: str, value: Any) -> Any:
    """A table with another value of a key. A mesh of another size keeps the wanted error, which decides on its symmetry."""
    if isinstance(table, Mesh) and key in OF_SIZE:
        return table.model_copy(update={**dict.fromkeys(OF_SIZE), key: value})
    return table.with_key(key, value)
