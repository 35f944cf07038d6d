"""What every report page says of its case: in words, as its file, and how to run it again."""

import shlex

from indentfit import indenters, samples

from .page import Code, Lines, Part, Section, Table, Text


def case_words(case):
    """Lines on a case, from `report.folder.case_facts`; () where a result has none."""
    if not case:
        return ()
    sample, indenter, mesh, material = (case[name] for name in ("sample", "indenter", "mesh", "material"))
    lines = [f"Sample: {_shape(samples.SHAPES, sample)}, thickness {number(sample['thickness'])} mm, {sample['base']} base"]
    friction = "sticking" if indenter["friction"] == "stick" else f"friction coefficient {number(indenter['friction'])}"
    lines.append(f"Indenter: rigid {_shape(indenters.SHAPES, indenter)}, {friction}")
    bulk = (
        f"bulk modulus {number(material['kappa'])} kPa"
        if material["kappa"]
        else f"bulk modulus {number(material['bulk_ratio'])} x shear modulus"
    )
    lines.append(f"Material: {material['model'] or material['energy']}, {bulk}")
    if case.get("equation"):
        lines.append(f"Energy: {' '.join(case['equation'].split())}")
    asked = (
        f"elements of {number(mesh['size'])} mm"
        if mesh["size"]
        else f"about {mesh['elements']} elements"
        if mesh["elements"]
        else "the default"
    )
    lines.append(f"Mesh of the quarter sample: {asked}, {case['solver']['element']} bricks")
    return tuple(lines)


def _shape(shapes, table):
    """A shape in its own words; its name alone where the package that offers it is not installed here."""
    shape = shapes.make(table)
    return shape.words() if shape else table["shape"]


def tests_table(case, caption):
    """The tests of a case."""
    rows = [
        (
            test["name"],
            f"{test['angle']}",
            test["curve"] or "none: simulated only",
            str(test["n"]),
            number(test["depth_mm"]),
            number(test["weight"]),
        )
        for test in case["tests"]
    ]
    return Table(caption, ("Test", "Fibre angle (°)", "Curve", "Points", "Depth (mm)", "Weight"), tuple(rows))


def again_section(folder, result, command):
    """The case file, and the commands that give the result again."""
    overrides = result.get("overrides", [])
    options = "".join(f" --set {shlex.quote(one)}" for one in overrides)
    parts: list[Part] = [
        Text("From this folder:"),
        Code("Command that gives this result again", f"indentfit {command} case.toml{options} -o ../again"),
    ]
    versions = result.get("versions") or {}
    hashes = result.get("case_hash")
    facts = [f"Hash of the case: {hashes}"] if hashes else []
    facts += [f"Versions: {', '.join(f'{name} {version}' for name, version in versions.items())}"] if versions else []
    if facts:
        parts.append(Lines(tuple(facts)))
    if overrides:
        parts.append(Text("The file below is a verbatim copy; the keys after --set replace its own."))
    if (folder / "case.toml").is_file():
        parts.append(Code("The case file", (folder / "case.toml").read_text(encoding="utf-8-sig")))
    return Section("again", "The case, and how to get this again", tuple(parts))


def number(value, digits=4):
    """A number in words; a dash where there is none."""
    if value is None:
        return "–"
    return value if isinstance(value, str) else f"{value:.{digits}g}"


def computed(value, digits=4):
    """A number in words with all of its digits, zeros too, so that those of a column can be compared."""
    if value is None:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 10**digits else f"{value:#.{digits}g}".rstrip(".")


def percent(share, digits=3):
    """A share in percent."""
    return "–" if share is None else f"{100 * share:.{digits}g} %"


def signed_percent(share):
    """A change in percent, with its sign."""
    return "–" if share is None else f"{100 * share:+.2f} %"
