"""How the fitted parameters themselves move when a key of the case, or its mesh, is another: one whole fit for each."""

import importlib.metadata
from dataclasses import asdict, dataclass

from indentfit.case import require_fittable
from indentfit.errors import IndentfitError
from indentfit.inverse.fit import fit


@dataclass(frozen=True)
class Refit:
    """One fit: name -> value and standard error (None where not known) of the free parameters, and its objective, mN.

    label: what was changed; cause: why there is no fit, or None; success: whether it converged.
    """

    label: str
    parameters: dict[str, dict]
    objective: float | None
    success: bool
    cause: str | None


def refits(labelled, kept, progress=None):
    """Refit of each (label, Case); progress: called with (share done, note).

    kept: mapping of what is finished, added to. Raises CaseError where a case has nothing to fit, before any is fitted.
    """
    for _, case in labelled:
        require_fittable(case)
    found = []
    for n, (label, case) in enumerate(labelled):
        key = f"refit {importlib.metadata.version('indentfit')} {case.hash}"
        if key not in kept:
            kept[key] = asdict(_fitted(label, case, n, len(labelled), progress))
        found.append(Refit(**{**kept[key], "label": label}))
    return tuple(found)


def _fitted(label, case, number, total, progress):
    def report(share, note=""):
        if progress:
            progress((number + share) / total, f"{label}; {note}")

    try:
        result = fit(case, report)
    except IndentfitError as error:
        return Refit(label, {}, None, False, " ".join(str(error).split()))
    if result.objective is None:
        return Refit(label, {}, None, False, result.message)
    parameters = {name: {key: result.parameters[name][key] for key in ("value", "stderr", "unit")} for name in result.free}
    return Refit(label, parameters, result.objective, result.success, None)
