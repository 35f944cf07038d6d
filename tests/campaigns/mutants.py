"""Mutation testing: small changes to the code, one at a time, that the tests should notice.

    nice -n 19 python tests/campaigns/mutants.py [--number 25] [--seed 0] [--only material/model.py ...]

From each file a sample of mutants is drawn: an operator, a comparison or a number changed, a condition turned round, a statement
left out. Each is run against a fast part of the tests in a copy of the project, which is left alone. Prints each mutant that
survives, and the share that was killed; exit code 1 below 80 %. A mutant may be equal to the original (a tolerance, a limit of
work): look at each.
"""

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HOME = Path(__file__).parents[2]
TESTS = {
    "material/model.py": ["tests/test_material.py", "tests/test_typed_energy.py"],
    "material/derive.py": ["tests/test_material.py", "tests/test_typed_energy.py"],
    "material/jets.py": ["tests/test_jets.py"],
    "material/typed_energy.py": ["tests/test_material.py", "tests/test_typed_energy.py"],
    "fem/contact.py": ["tests/test_contact.py"],
    "inverse/problem.py": [
        "tests/test_objective.py",
        "tests/test_inverse.py",
        "-k",
        "test_objective or (equation or scale or squares or candidate) and not small and not proportional",
    ],
}
SWAPS = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.MatMult: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And, ast.USub: ast.UAdd,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
TIME = 180  # seconds of one mutant's tests; one that hangs is killed, too


def places(tree):
    """(node, how) of each change that can be made, without annotations and the texts of messages."""
    skipped = set()
    for node in ast.walk(tree):
        hidden = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        hidden += [node] if isinstance(node, ast.JoinedStr) else []
        skipped |= {id(inner) for one in hidden if one for inner in ast.walk(one)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.BinOp | ast.BoolOp | ast.UnaryOp) and type(node.op) in SWAPS:
            yield node, "operator"
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            yield node, "no not"
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPS:
            yield node, "comparison"
        elif isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            yield node, "number"
        elif isinstance(node, ast.If | ast.IfExp | ast.While):
            yield node, "condition"
        elif isinstance(node, ast.Expr | ast.AugAssign | ast.Raise | ast.Continue | ast.Break) and not (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        ):
            yield node, "left out"


def mutate(tree, node, how):
    """Change the node in place; the line is that of the change."""
    if how in ("operator", "comparison"):
        if isinstance(node, ast.Compare):
            node.ops[0] = SWAPS[type(node.ops[0])]()
        else:
            node.op = SWAPS[type(node.op)]()
    elif how == "number":
        node.value = node.value + 1 if isinstance(node.value, int) else node.value * 1.5 + (node.value == 0)
    elif how == "condition":
        node.test = ast.UnaryOp(ast.Not(), node.test)
    elif how == "no not":
        node.op, node.operand = ast.Not(), ast.UnaryOp(ast.Not(), node.operand)
    else:
        for parent in ast.walk(tree):
            for _, body in ast.iter_fields(parent):
                if isinstance(body, list) and node in body:
                    body[body.index(node)] = ast.Pass()


def killed(place, tests):
    """Whether the tests fail in a copy of the project."""
    own = {"PYTHONPATH": str(place), "NUMBA_CACHE_DIR": str(place / "compiled"), "PYTHONDONTWRITEBYTECODE": "1"}
    environment = os.environ | own
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, timeout=TIME)
    except subprocess.TimeoutExpired:
        return True
    if done.returncode not in (0, 1, 2) and done.returncode > 0:  # below 0: compiled code that wrote beyond its arrays
        sys.exit(done.stdout[-2000:] + done.stderr[-2000:])
    return done.returncode != 0


def project(place):
    """A copy of the project that Python finds before the installed one."""
    for name in ("indentfit", "tests", "cases"):
        shutil.copytree(HOME / name, place / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(HOME / "materials", place / "indentfit" / "materials", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(HOME / name, place)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--number", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=list(TESTS), default=list(TESTS))
    options = parser.parse_args()
    place, total, dead = Path(tempfile.mkdtemp(prefix="mutants-")), 0, 0
    project(place)
    for name in options.only:
        path, tests = place / "indentfit" / name, TESTS[name]
        source = path.read_text()
        if killed(place, tests):
            sys.exit(f"{name}: its tests fail without a change")
        tree, count = ast.parse(source), 0
        number_of_places = len(list(places(tree)))
        drawn = random.Random(options.seed).sample(range(number_of_places), min(options.number, number_of_places))
        for n in sorted(drawn):
            mutant = copy.deepcopy(tree)
            node, how = list(places(mutant))[n]
            line, before = node.lineno, ast.unparse(node)[:70]
            mutate(mutant, node, how)
            path.write_text(ast.unparse(ast.fix_missing_locations(mutant)))
            gone = killed(place, tests)
            count += gone
            if not gone:
                print(f"survives: {name}:{line} {how}: {before}", flush=True)
        path.write_text(source)
        print(f"{name}: {count} of {len(drawn)} killed ({number_of_places} places)", flush=True)
        total, dead = total + len(drawn), dead + count
    print(f"{dead} of {total} mutants killed ({dead / total:.0%})")
    shutil.rmtree(place)
    sys.exit(dead < 0.8 * total)


if __name__ == "__main__":
    main()
