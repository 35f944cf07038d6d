"""The fits of a set of samples as one population: `fit --population`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any, ClassVar

import numpy as np
from pydantic import TypeAdapter

from indentfit.case import Case
from indentfit.errors import CaseError
from indentfit.inference.fit import FitWithRuns
from indentfit.inference.law_curves import alternatives_of
from indentfit.inference.per_sample import PerSample, SampleFit
from indentfit.inference.population import FEWEST, Hierarchy, hierarchy, pooled_sd
from indentfit.inference.residual_noise import unknown_noise
from indentfit.inference.sample_density import SampleDensity
from indentfit.inference.verdicts import kind_of

ALL = "all samples"
CONTROLS = ("control", "controls", "untreated", "sham", "healthy")  # names of a group with which others are compared
DETERMINED = ("determined", "weakly determined")
OWN = ("offset", "force")  # inputs whose errors each sample has by itself


@dataclass(frozen=True, repr=False, eq=False)
class Population:
    """Samples as one population.

    Parameters
    ----------
    per_sample : PerSample
        The single fits, and their plain spread.
    groups : dict of sample -> group
    reference : str
        The group with which the others are compared.
    hierarchy : Hierarchy or None
        None where fewer than FEWEST samples could be used.
    plain : dict of parameter -> float
        Plain standard deviation of the single fits, pooled over the groups, over the mean: with noise and errors in it.
    left_out : dict of sample -> why the sample is not part of the population
    """

    FORMAT: ClassVar[str] = "indentfit.population/2"

    per_sample: PerSample
    groups: dict[str, str]
    reference: str
    hierarchy: Hierarchy | None
    plain: dict[str, float]
    left_out: dict[str, str]

    def as_json(self) -> dict[str, Any]:
        """The stable keys of a population's result.json, under the tag `format`."""
        return {
            "format": self.FORMAT,
            "groups": self.groups,
            "reference": self.reference,
            "population": None if self.hierarchy is None else asdict(self.hierarchy),
            "plain_sd": self.plain,
            "not_determined": list(self.weak),
            "left_out": self.left_out,
            "per_sample": self.per_sample.as_json(),
        }

    @property
    def told(self) -> dict[str, int]:
        """For each parameter the number of samples whose own curves determine it, if only weakly."""
        names = list(self.hierarchy.parameters) if self.hierarchy else []
        singles = [known.parameters for known in self.per_sample.samples if known.sample not in self.left_out]
        return {name: sum(kind_of(known[name]) in DETERMINED for known in singles) for name in names}

    @property
    def weak(self) -> tuple[str, ...]:
        """The parameters that most samples do not determine. Their spread is no number to be trusted: twelve samples that differ by
        20 % and determine it in none gave 59 to 4143 % once, and with the prior of the spread 12 to 300 %."""
        return tuple(name for name, told in self.told.items() if 2 * told < len(self.groups) - len(self.left_out))

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Population":
        """The population that result.json holds."""
        fitted = None if value["population"] is None else TypeAdapter(Hierarchy).validate_python(value["population"])
        singles = PerSample.from_json(value["per_sample"])
        return cls(singles, dict(value["groups"]), value["reference"], fitted, dict(value["plain_sd"]), dict(value["left_out"]))

    def summary(self) -> str:
        """The population in words, as the command prints it."""
        from indentfit.report.population import population_lines

        return "\n".join(population_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of the population; saved as SVG and PNG where a path is given."""
        from indentfit.report.population import population_figure

        return population_figure(self, path)

    def __repr__(self) -> str:
        return f"Population({len(self.groups)} samples{'' if self.hierarchy else '; too few to be one population'})"


def require_positive(case: Case) -> None:
    """Raise CaseError unless the logarithm of every free parameter exists within its range, and the law has no misfit."""
    if (scale := case.fit.discrepancy.stated) is not None:
        said = "a population knows no misfit of the law; remove the table, or fit without --population"
        raise CaseError([f"fit.discrepancy.scale = {scale}: {said}"])
    if negative := [name for name, bounds in case.free.items() if bounds.min < 0]:
        raise CaseError([f"{negative[0]}: min is below 0, and a population is one of logarithms; raise min, or give a number"])


def population(fits: Sequence[SampleFit], singles: PerSample, groups: Mapping[str, str], seed: int = 0) -> Population:
    """The population of fitted samples, without a run.

    Parameters
    ----------
    fits : sequence of SampleFit
        With their runs, as `fit_sample` makes them.
    singles : PerSample
        The same fits.
    groups : mapping of sample -> group
        Empty for one group.
    seed : int

    Returns
    -------
    Population
    """
    member = {fitted.sample: groups.get(fitted.sample, ALL) for fitted in fits}
    left_out = {fitted.sample: why for fitted in fits if (why := _unusable(fitted))}
    used = [fitted for fitted in fits if fitted.sample not in left_out]
    reference = _reference(list(member.values()))
    joint, plain = None, {}
    if len(used) >= FEWEST:
        names = list(singles.free)
        samples = [_density(fitted, member[fitted.sample], seed) for fitted in used]
        values = np.array([[_result(fitted).parameters[name].value for name in names] for fitted in used])
        units = {name: _result(used[0]).parameters[name].unit for name in names}
        shared = {name: _shared(used, name) for name in names}
        own = [sample.draws() for sample in samples]
        joint = hierarchy(own, units, shared, reference, seed, lambda there: [s.under(there[s.group]) for s in samples])
        pooled = {name: pooled_sd(values[:, k], [member[fitted.sample] for fitted in used]) for k, name in enumerate(names)}
        plain = {name: sd for name, sd in pooled.items() if sd is not None}
    return Population(singles, member, reference, joint, plain, left_out)


def _reference(groups: Sequence[str]) -> str:
    """The group with which the others are compared: one whose name says so, otherwise the first."""
    return next((group for group in groups if group.strip().lower() in CONTROLS), groups[0])


def _unusable(fitted: SampleFit) -> str | None:
    if fitted.result is None:
        return fitted.problem or "no fit"
    if fitted.result.no_fit:
        return fitted.result.no_fit
    return None if fitted.whole is not None and alternatives_of(fitted.whole) else "the search found no optimum"


def _result(fitted: SampleFit) -> Any:
    assert fitted.result is not None  # the samples without a result are left out
    return fitted.result


def _density(fitted: SampleFit, group: str, seed: int) -> SampleDensity:
    whole: FitWithRuns | None = fitted.whole
    assert whole is not None  # the samples without runs are left out
    problem, pairs = whole.problem, alternatives_of(whole)
    known = [(prior, curves, unknown_noise(problem, 0.0, moves=curves.moves)) for prior, curves in pairs]
    return SampleDensity.of(fitted.sample, group, known, seed)


def _shared(fits: Sequence[SampleFit], name: str) -> float:
    """Relative standard deviation of a parameter by errors that all samples share: the mesh, and inputs of the rig. Where these are
    coordinates of the fits, each sample is integrated over them by itself; as the rig is the same for all samples, what stays
    uncertain of them in one sample does not average out over the samples, and widens the interval of the mean."""
    sizes = []
    for fitted in fits:
        estimate, inputs = _result(fitted).parameters[name], _result(fitted).uncertain.inputs
        effects = [
            share.effect.get(name) or 0.0
            for cause, share in inputs.items()
            if cause.partition(" ")[0] not in OWN and cause != "base"
        ]
        if estimate.value and not estimate.at_bound:
            sizes.append(float(np.linalg.norm(effects)) / abs(estimate.value) if effects else 0.0)
    return float(median(sizes)) if sizes else 0.0
