"""The case on every report page: in words, as a file, and with the command that runs it again."""

import hashlib
import shlex
from pathlib import Path

from indentfit.digits import plainly
from indentfit.report.formulas import drawn_formulas
from indentfit.report.page import Code, Lines, Part, Section, Table, Text
from indentfit.report.schema import CaseFacts, Stored

CITATION = (
    "To cite: The indentfit authors, indentfit: indentation records of soft tissue to material parameters with honest error bars "
    "(software; name its version), and the paper whose method it began with: Feng, Lee, Sun, Ji, Zhao 2017, J Mech Behav Biomed "
    "Mater 65:490-501, doi 10.1016/j.jmbbm.2016.09.020"
)


def case_words(case: CaseFacts) -> tuple[str, ...]:
    """Lines on a case."""
    material, mesh = case.material, case.mesh
    bulk = f"bulk modulus {number(material.kappa)} kPa" if material.kappa else ""
    bulk = bulk or (f"bulk modulus {number(material.bulk_ratio)} x shear modulus" if material.bulk_ratio else "")
    bulk = bulk or f"Poisson's ratio {number(material.poisson_ratio)}"
    asked = f"elements of {number(mesh.size)} mm" if mesh.size else f"about {mesh.elements} elements" if mesh.elements else ""
    lines = [
        *([f"Sample: {case.sample}", f"Indenter: {case.indenter}"] if case.sample else []),
        *(f"Layer {words}" for words in case.layers),
        *([] if case.layers else [f"Material: {material.model or material.energy}, {bulk}{case.bulk_doubt}"]),
        *([f"Energy: {drawn_formulas(case.equation)}"] if case.equation else []),
        *(f"Test {test.name}: {test.own}" for test in case.tests if test.own),
        *([_mesh_words(case, asked)] if case.sample else []),
    ]
    return tuple(lines)


def _mesh_words(case: CaseFacts, asked: str) -> str:
    chosen = f"chosen for an error of the force of at most {100 * case.mesh.wanted_error:g} %"
    return f"Mesh: {asked or chosen}, {case.element} elements"


def tests_table(case: CaseFacts, caption: str) -> Table:
    """The tests of a case."""
    rows = tuple(
        (
            test.name,
            "–" if test.angle is None else f"{test.angle}",
            f"{test.source or 'none: simulated only'}{' (synthetic)' if test.synthetic else ''}",
            str(test.points),
            test.depth,
            number(test.weight),
        )
        for test in case.tests
    )
    header = ("Test", "Fibre angle (°)", "Curve", "Points", "Depth (mm)", "Weight")
    if all(test.angle is None for test in case.tests):
        return Table(caption, (*header[:1], *header[2:]), tuple((row[0], *row[2:]) for row in rows))
    return Table(caption, header, rows)


def again_section(stored: Stored, command: str) -> Section:
    """The case file, and the commands that give the result again."""
    options = "".join(f" --set {shlex.quote(override)}" for override in stored.overrides)
    parts: list[Part] = [
        Text("From this folder:"),
        Code("Command that gives this result again", f"indentfit {command} case.toml{options} -o ../again"),
    ]
    facts = [f"Hash of the case: {stored.case_hash}"] if stored.case_hash else []
    if stored.versions:
        facts.append(f"Versions: {', '.join(f'{name} {version}' for name, version in stored.versions.items())}")
    parts += [*_files(stored), Lines((*facts, CITATION))]
    if stored.overrides:
        parts.append(Text("The file below is a verbatim copy; the keys after --set replace keys of the file."))
    copy = stored.folder / "case.toml"
    if copy.is_file():
        parts.append(Code("The case file", copy.read_text(encoding="utf-8-sig")))
    return Section("again", "The case, and how to get this result again", tuple(parts))


def _files(stored: Stored) -> list[Part]:
    """The files of the curves and records that the folder holds, with their hashes."""
    sources = dict.fromkeys(test.source for test in (stored.case.tests if stored.case else ()) if test.source)
    rows = tuple(
        (source, hashlib.sha256((stored.folder / source).read_bytes()).hexdigest())
        for source in sources
        if ".." not in Path(source).parts and (stored.folder / source).is_file()
    )
    return [Table("Files of the curves, with their SHA-256", ("File", "SHA-256"), rows)] if rows else []


def number(value: float | str | None, digits: int = 4) -> str:
    """A number in words; a dash where there is none."""
    if value is None:
        return "–"
    return value if isinstance(value, str) else plainly(value, digits)


def computed(value: float | None, digits: int = 4) -> str:
    """A number with all of its digits, zeros too, so that the numbers of a column can be compared."""
    if value is None:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 10**digits else f"{value:#.{digits}g}".rstrip(".")


def percent(share: float | None, digits: int = 3) -> str:
    """A share in percent."""
    return "–" if share is None else f"{100 * share:.{digits}g} %"


def signed_percent(share: float | None) -> str:
    """A change in percent, with its sign."""
    return "–" if share is None else f"{100 * share:+.2f} %"
