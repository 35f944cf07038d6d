"""Formulas as the code writes them, `mu/2 (I1 - 3)^2`, set as MathML, which browsers draw without a script.

The notation is that of the materials' docstrings: powers with ^, products with a space, `/` divides what stands before it in its
product by the factor behind it, `sqrt(x)`, `exp(x)`, `sum(x, i = 1 to 3)`. A name is a Greek letter, one letter or a word; an
index follows it (`c10`, `E_along`). l1, l2, l3 and l are stretches, so they are written with the Greek lambda.
"""

import re
from collections.abc import Container, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from markupsafe import escape

from indentfit.report.typeset import GREEK, SUBSCRIPTS, SUPERSCRIPTS

FUNCTIONS = ("sqrt", "exp", "log", "max", "cos", "sin", "sum")
TOKEN = re.compile(r"\s*(?:(\d+(?:\.\d+)?)|([A-Za-z]+(?:_?\d+)?(?:_[A-Za-z]+)?)|(->|<=|>=|[-+*/^=<>()\[\],]|\.(?=[A-Za-z])))")
LETTER = "|".join(sorted(GREEK, key=len, reverse=True))
NAME = re.compile(rf"({LETTER}|[A-Z](?=[a-z]$)|[A-Za-z]+?)(?:_?(\d+))?(?:_([A-Za-z]+)|(?<=[A-Z])([a-z]))?$")
RELATIONS = {"=": "=", "<": "&lt;", ">": "&gt;", "<=": "≤", ">=": "≥", "->": "→", "to": "…"}
ENDS = ("(", "[")
TIMES, APPLY = "<mo>&#x2062;</mo>", "<mo>&#x2061;</mo>"  # invisible: a product, a function of
MARK = "\u2063"  # the invisible separator
WIDEST = 60  # words of a formula within a text


class NoFormula(Exception):
    """A text that is no formula."""


class Token(NamedTuple):
    """A number, a name or an operator."""

    kind: str
    text: str


def math(text: str, block: bool = False) -> str:
    """A formula as a MathML element, which carries the formula as it was written for those who hear the page.

    Raises
    ------
    NoFormula
        The text is none.
    """
    tokens = _tokens(text)
    inner = _Reader(tokens).all()
    kind = ' displaystyle="true"' if block else ""
    return f'<math{kind} alttext="{escape(" ".join(text.split()))}">{inner}</math>'


def relations(text: str) -> list[str]:
    """The relations of a formula that commas outside of its brackets part, such as psi = ... and E = ..."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def with_formulas(text: str, names: Container[str] = ()) -> str:
    """A paragraph with its formulas between dollar signs, as the pages of the guide have them.

    Parameters
    ----------
    text : str
    names : container of str
        Words that are names in its formulas, such as the parameters of a law; Greek letters, single letters and those with an
        index are known.
    """
    words, done, start = text.split(), [], 0
    while start < len(words):
        stop = next(
            (stop for stop in range(min(len(words), start + WIDEST), start, -1) if _is_formula(words[start:stop], names)), 0
        )
        if not stop:
            done.append(words[start])
            start += 1
            continue
        formula = " ".join(words[start:stop])
        bare = formula.rstrip(".,;:")
        done.append(f"${bare}${formula[len(bare) :]}")
        start = stop
    return " ".join(done)


def drawn_formulas(text: str) -> str:
    """A paragraph with its formulas between marks that `split_formulas` knows, which no other text has."""
    return text if "$" in text else with_formulas(text).replace("$", MARK)


def split_formulas(text: str) -> list[str]:
    """The parts of a paragraph of `drawn_formulas`: text and formula in turn."""
    return text.split(MARK)


def lined(text: str) -> str:
    """A paragraph with its formulas in one line of letters, such as (I₁ − 3)², for texts that are copied into others."""
    parts = with_formulas(text).split("$")
    return "".join(_letters(part) if n % 2 else part for n, part in enumerate(parts))


def _letters(formula: str) -> str:
    text = re.sub(r"\^(\d)(?![\w.])", lambda power: power[1].translate(SUPERSCRIPTS), formula.replace(" - ", " − "))
    return re.sub(r"(?<![A-Za-z])([A-Za-z])(\d+)(?![0-9A-Za-z_])", lambda name: name[1] + name[2].translate(SUBSCRIPTS), text)


def _is_formula(words: list[str], names: Container[str]) -> bool:
    """Whether words are one whole formula with an operation in it, with no word of the language for a name."""
    text = " ".join(words).rstrip(".,;:")
    if words[0] in ("a", "A", "I") or not re.search(r"[=+^/<>]|- |\d [a-z(]|\w \(", text):
        return False
    try:
        tokens = _tokens(text)
        _Reader(tokens).all()
    except NoFormula:
        return False
    known = [token for token in tokens if token.kind == "name"]
    return bool(known) and all(_known(token.text, names) for token in known)


def _known(word: str, names: Container[str]) -> bool:
    stem = re.sub(r"_?\d+$|_[A-Za-z]+$", "", word)
    return word in names or len(stem) == 1 or stem in GREEK or word in ("to", "dW", "dl", *FUNCTIONS)


def _tokens(text: str) -> list[Token]:
    tokens, place = [], 0
    text = text.strip()
    while place < len(text):
        match = TOKEN.match(text, place)
        if match is None:
            raise NoFormula(text)
        number, name, operator = match.groups()
        tokens.append(Token("number", number) if number else Token("name", name) if name else Token("operator", operator))
        place = match.end()
    return tokens


@dataclass
class _Reader:
    """Reads tokens from left to right; each method returns the MathML of what it read."""

    tokens: list[Token]
    place: int = 0

    def all(self) -> str:
        inner = self._list()
        if self.place < len(self.tokens) or not self.tokens:
            raise NoFormula
        return f"<mrow>{inner}</mrow>"

    def _list(self) -> str:
        """Relations, one behind the other with commas."""
        parts = [self._relation()]
        while self._take(","):
            parts.append(self._relation())
        return "<mo>,</mo>".join(parts)

    def _relation(self) -> str:
        parts = [self._sum()]
        while self.place < len(self.tokens) and self.tokens[self.place].text in RELATIONS:
            parts.append(f"<mo>{RELATIONS[self._next().text]}</mo>{self._sum()}")
        return "".join(parts)

    def _sum(self) -> str:
        parts = ["<mo>−</mo>" if self._take("-") else "", self._product()]
        while self.place < len(self.tokens) and self.tokens[self.place].text in "+-":
            sign = "−" if self._next().text == "-" else "+"
            parts.append(f"<mo>{sign}</mo>{self._product()}")
        return "".join(parts)

    def _product(self) -> str:
        parts = [self._power()]
        while self.place < len(self.tokens):
            if self._take("/"):
                above = TIMES.join(parts) if len(parts) > 1 else _bare(parts[0])
                parts = [f"<mfrac>{_row(above)}{_row(_bare(self._power()))}</mfrac>"]
            elif self._take("."):
                parts[-1] += f"<mo>·</mo>{self._power()}"
            elif self._take("*") or self._begins():
                parts.append(self._power())
            else:
                break
        return TIMES.join(parts)

    def _begins(self) -> bool:
        """Whether a factor begins here."""
        token = self.tokens[self.place]
        return (token.kind != "operator" and token.text != "to") or token.text in ENDS

    def _power(self) -> str:
        base = self._factor()
        if not self._take("^"):
            return base
        minus = "<mo>−</mo>" if self._take("-") else ""
        raised = _row(minus + _bare(self._factor()))
        if base.startswith("<msub>"):  # the power above the index
            return f"<msubsup>{base.removeprefix('<msub>').removesuffix('</msub>')}{raised}</msubsup>"
        return f"<msup>{_row(base)}{raised}</msup>"

    def _factor(self) -> str:
        token = self._next()
        if token.kind == "number":
            return f"<mn>{token.text}</mn>"
        if token.text in ENDS:
            inner = self._list()
            if self._next().text != {"(": ")", "[": "]"}[token.text]:
                raise NoFormula
            return _fenced(inner, token.text)
        if token.kind != "name" or token.text == "to":
            raise NoFormula
        if token.text in FUNCTIONS and self.place < len(self.tokens) and self.tokens[self.place].text == "(":
            return self._function(token.text)
        return _name(token.text)

    def _function(self, name: str) -> str:
        self.place += 1
        inner = self._sum() if name == "sum" else self._list()
        over = ""
        if name == "sum" and self._take(","):
            over = self._list()
        if self._next().text != ")":
            raise NoFormula
        if name == "sqrt":
            return f"<msqrt>{inner}</msqrt>"
        if name == "sum":
            return f"<mrow>{_summed(over)}{inner}</mrow>"
        return f"<mrow><mi>{name}</mi>{APPLY}{_fenced(inner, '(')}</mrow>"

    def _next(self) -> Token:
        if self.place >= len(self.tokens):
            raise NoFormula
        self.place += 1
        return self.tokens[self.place - 1]

    def _take(self, text: str) -> bool:
        there = self.place < len(self.tokens) and self.tokens[self.place].text == text
        self.place += there
        return there


def _summed(over: str) -> str:
    """The sign of a sum, with its first and last index where it has them."""
    first, dots, last = over.partition("<mo>…</mo>")
    if dots:
        return f"<munderover><mo>∑</mo><mrow>{first}</mrow><mrow>{last}</mrow></munderover>"
    return f"<munder><mo>∑</mo><mrow>{over}</mrow></munder>"


def _fenced(inner: str, bracket: str) -> str:
    return f"<mrow><mo>{bracket}</mo>{inner}<mo>{')' if bracket == '(' else ']'}</mo></mrow>"


def _bare(markup: str) -> str:
    """A bracketed group without its brackets, where a fraction's bar or a raised place says what it holds."""
    if markup.startswith("<mrow><mo>(</mo>") and markup.endswith("<mo>)</mo></mrow>") and _one_group(markup):
        return markup.removeprefix("<mrow><mo>(</mo>").removesuffix("<mo>)</mo></mrow>")
    return markup


def _one_group(markup: str) -> bool:
    """Whether the first bracket closes at the very end."""
    depth = 0
    brackets = list(re.finditer(r"<mo>([()])</mo>", markup))
    for bracket in brackets:
        depth += 1 if bracket[1] == "(" else -1
        if depth == 0:
            return bracket is brackets[-1]
    return False


def _row(markup: str) -> str:
    """One element, as a fraction and a power need their parts."""
    return f"<mrow>{markup}</mrow>"


def _name(name: str) -> str:
    match = NAME.match("lambda" + name[1:] if re.fullmatch(r"l[123]?", name) else name)
    if match is None:
        raise NoFormula
    stem, number, word, letter = match.groups()
    base = f"<mi>{GREEK.get(stem, stem)}</mi>"
    if not (number or word or letter):
        return base
    parts = [f"<mn>{number}</mn>"] if number else []
    parts += ["".join(_indices(word or letter))] if word or letter else []
    index = "<mo>,</mo>".join(parts)
    return f"<msub>{base}<mrow>{index}</mrow></msub>"


def _indices(word: str) -> Iterator[str]:
    """The letters of an index such as ij, or one word."""
    if word in ("ij", "ii", "ik"):
        yield from (f"<mi>{letter}</mi>" for letter in word)
    else:
        yield f"<mi>{word}</mi>"
