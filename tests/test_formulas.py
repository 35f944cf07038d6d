"""Formulas of the guide: what a page shows of a law is the energy that the law computes, read back from the MathML."""

import functools
import itertools
import re
import xml.etree.ElementTree as ET

import pytest
import sympy

from indentfit.material import installed
from indentfit.report.formulas import NoFormula, drawn_formulas, lined, math, relations, with_formulas
from indentfit.report.guide import html_page
from indentfit.report.guide_parts import generated_parts
from indentfit.report.page import marked
from indentfit.report.typeset import GREEK, typeset

LETTERS = {letter: name for name, letter in GREEK.items()}
SERIES = {1: "1/2", 2: "1/20", 3: "11/1050", 4: "19/7000", 5: "519/673750"}  # of the inverse Langevin function: Arruda, Boyce 1993
RANGES = {"i=1…2": [1, 2], "i=1…3": [1, 2, 3], "i=1…5": [1, 2, 3, 4, 5], "i=4,6": [4, 6]}


def formula(element):
    """What a reader takes from MathML, as Python; a sum is written out."""
    inner = list(element)
    match element.tag:
        case "mn":
            return element.text
        case "mi":
            return LETTERS.get(element.text, element.text)
        case "mo":
            return {"\u2062": "*", "\u2061": "", "−": "-", "·": "*", "[": "(", "]": ")"}.get(element.text, element.text)
        case "mfrac":
            return f"(({formula(inner[0])})/({formula(inner[1])}))"
        case "msup":
            return f"({formula(inner[0])})**({formula(inner[1])})"
        case "msubsup":
            return f"({formula(inner[0])}_{''.join(map(formula, inner[1]))})**({formula(inner[2])})"
        case "msqrt":
            return f"sqrt({''.join(map(formula, inner))})"
        case "msub":
            return f"{formula(inner[0])}_{''.join(map(formula, inner[1]))}"
    if inner and inner[0].tag in ("munder", "munderover"):
        return f"({'+'.join(written_out(inner[0], ''.join(map(formula, inner[1:]))))})"
    return "".join(map(formula, inner))


def written_out(sign, term):
    """The terms of a sum."""
    over = "…".join("".join(map(formula, part)) for part in list(sign)[1:])
    if over == "1<=i+j<=2" or over == "1≤i+j≤2":
        pairs = ((i, j) for i, j in itertools.product(range(3), repeat=2) if 1 <= i + j <= 2)
        return [term.replace("c_ij", f"c_{i}{j}").replace("**(i)", f"**{i}").replace("**(j)", f"**{j}") for i, j in pairs]
    return [re.sub(r"\b_?i\b|(?<=_)i\b", str(i), re.sub(r"(?<=\d)\*i\b", f"*{i}", term)) for i in RANGES[over]]


@functools.cache
def page():
    return generated_parts()["materials"]


def energy_shown(name):
    """The energy of a law as the page of the materials shows it, as SymPy reads it, with symbols without underscores."""
    text = page().split(f"## {name}\n")[1].split("$")[1]
    sides = [formula(ET.fromstring(math(row))).split("=", 1) for row in relations(text)]
    families = [[re.sub(r"(?<=_)i\b", i, side) for side in both] for both in sides if both[0] == "E_i" for i in "46"]
    sides = [both for both in sides if both[0] != "E_i"] + families
    names = {word for side in sides for word in re.findall(r"[A-Za-z]\w*", "=".join(side))}
    known = {"exp": sympy.exp, "log": sympy.log, "sqrt": sympy.sqrt, "max": sympy.Max}
    symbols = {word: sympy.Symbol(word.replace("_", ""), positive=True) for word in names - set(known)}
    symbols |= {f"C_{i}": sympy.Rational(value) for i, value in SERIES.items()} if name == "arruda_boyce" else {}
    values = {left: sympy.sympify(right, locals=known | symbols) for left, right in sides}
    energy = values.pop("psi")
    for _ in values:
        energy = energy.subs({symbols.get(left, left): value for left, value in values.items()})
    return energy


@pytest.mark.parametrize("name", sorted(set(installed()) - {"weiss", "fung_orthotropic"}))
def test_the_formula_that_a_page_shows_is_the_energy_of_the_law(name):
    """`weiss` and `fung_orthotropic` are told by a derivative and by strains, which test_laws compares."""
    law, shown = installed()[name], energy_shown(name)
    chosen = {"lambda_m": 1.7, "Jm": 9.0, "dispersion": 0.2, "dispersion_second": 0.1, "in_plane": 0.3, "out_of_plane": 0.4}
    values = {parameter: 0.21 + 0.13 * n for n, parameter in enumerate(law.parameters)} | chosen
    names = ("I1", "I2", "I4", "I5", "I6", "I7", "l1", "l2", "l3")
    state = dict(zip(names, (3.31, 3.24, 1.21, 1.53, 1.11, 1.36, 1.2, 0.9, 1 / 1.08), strict=True))
    written = {**{k.replace("_", ""): v for k, v in values.items()}, **state, "lambda1": 1.2, "lambda2": 0.9, "lambda3": 1 / 1.08}
    written |= {"d": 0.2, "A": 0.24, "B": 0.32, "In": 3.31 - 1.21 - 1.11}  # of holzapfel_spread: 2 s p, 2 s (1 - 2 p), I1 - I4 - I6
    pairs = {"k": ("k1", "k1_second"), "q": ("k2", "k2_second"), "d": ("dispersion", "dispersion_second")}
    written |= {f"{k}{i}": values.get(pair[n]) for k, pair in pairs.items() for n, i in enumerate("46")}
    numbers = {symbol: written[symbol.name] for symbol in shown.free_symbols}
    used = {k: v for k, v in state.items() if k in law.energy.__code__.co_varnames[: law.energy.__code__.co_argcount]}
    model = law(**{k: values[k] for k in law.parameters})
    assert float(shown.subs(numbers)) == pytest.approx(float(model.energy(**used)), rel=1e-12)


def test_a_formula_carries_its_text_and_is_well_formed():
    drawn = math("a_ii < 2 b/(c - 1) [x^-2, sqrt(y)]", block=True)
    assert ET.fromstring(drawn).get("alttext") == "a_ii < 2 b/(c - 1) [x^-2, sqrt(y)]"
    assert "<mfrac>" in drawn and "<msqrt>" in drawn and 'displaystyle="true"' in drawn


@pytest.mark.parametrize("text", ["", "mu +", "(a", "a)", "/ 2", "5 %", "x^", "a,, b", "c. E"])
def test_what_is_no_formula_is_refused(text):
    with pytest.raises(NoFormula):
        math(text)


def test_formulas_are_found_within_a_sentence():
    said = "Shear modulus 2 (c10 + c01); b -> 0 is neo-Hookean, and a fibre's E_along = (1 + zeta) E_across, as stated."
    assert with_formulas(said) == (
        "Shear modulus $2 (c10 + c01)$; $b -> 0$ is neo-Hookean, and a fibre's $E_along = (1 + zeta) E_across$, as stated."
    )
    assert with_formulas("At rest the fibres and/or the matrix are slack.") == "At rest the fibres and/or the matrix are slack."


def test_a_page_draws_formulas_and_leaves_other_dollar_signs():
    text = "# Title\n\n$psi = mu/2 (I1 - 3), E = max(a, 0)$\n\nIt is $a + b$, `$c$` and 5 $ or 6 $.\n"
    body = html_page("x", text).split("<main")[1]
    assert body.count("<math") == 3 and body.count('class="formula"') == 2
    assert "<code>$c$</code> and 5 $ or 6 $." in body


def test_a_report_draws_the_energy_of_a_case_and_shows_what_is_none_as_it_is():
    drawn = marked(drawn_formulas("psi = mu/2 (I1 - 3), isochoric; <b> & 5 $."))
    assert drawn == "ψ = μ/2 (I1 - 3), isochoric; &lt;b&gt; &amp; 5 $."
    drawn = marked(drawn_formulas("psi = mu/2 (I1 - 3), isochoric; <b> alone"))
    assert drawn.startswith("<math") and drawn.endswith("</math>, isochoric; &lt;b&gt; alone")


def test_a_formula_in_a_line_of_letters_has_its_powers_and_signs():
    text = lined("psi = mu/2 [(I1 - 3) + zeta (I4 - 1)^2 + phi (I5 - I4^2)], invariants isochoric")
    assert typeset(text) == "ψ = μ/2 [(I₁ − 3) + ζ (I₄ − 1)² + φ (I₅ − I₄²)], invariants isochoric"
