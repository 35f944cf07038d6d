"""How pages and figures write what the code writes in ASCII: Greek letters, true minus signs, powers."""

import re

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ", "kappa": "κ",
    "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ", "chi": "χ", "psi": "ψ",
    "omega": "ω",
}  # fmt: skip
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
EDGE = r"(?<![\w./\\=-])"  # no part of a file's name, of a key with points, or of an option
NAMES = re.compile(rf"{EDGE}({'|'.join(GREEK)})(?:_?(\d))?(?![\w\\-]|/(?!\d)|\.\w)")
MINUS = re.compile(r"(?<![\w./\\-])-(?=\d)")
POWERS = re.compile(r"\b(mm|mN|kPa|R)\^?2\b")
RELATIONS = {" <= ": " ≤ ", " >= ": " ≥ "}
TIMES = re.compile(r"(?<=\d) x (?=\d|shear)")
PERCENT = re.compile(r"(?<=\d)%(?!\w)")
MICRO = re.compile(r"(?<=\d )u(?=(?:m|N)\b)")
EXPONENT = re.compile(r"(?<=\d)e([+-])0?(\d+)\b")


def symbol(name: str) -> str:
    """The letter of a parameter, such as μ for mu and α₂ for alpha2; other names stay."""
    return NAMES.sub(_letter, name)


def typeset(text: str) -> str:
    """A sentence, or the cell of a table, with Greek letters of parameters, true minus signs, plus-minus signs, powers, micro
    signs and a space before a percent sign."""
    text = EXPONENT.sub(_power_of_ten, symbol(text).replace("+-", "±"))
    for written, shown in RELATIONS.items():
        text = text.replace(written, shown)
    text = MICRO.sub("µ", PERCENT.sub(" %", text))
    return TIMES.sub(" × ", POWERS.sub(r"\1²", MINUS.sub("−", text)))


def _letter(name: re.Match[str]) -> str:
    return GREEK[name[1]] + (name[2] or "").translate(SUBSCRIPTS)


def _power_of_ten(text: re.Match[str]) -> str:
    return " × 10" + f"{text[1].strip('+')}{text[2]}".translate(SUPERSCRIPTS)
