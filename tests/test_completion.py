"""What a shell completes after TAB: keys of the case, their values, and names of laws."""

import click
import pytest
from click.testing import CliRunner

from indentfit.case.keys import keys
from indentfit.cli import main

pytestmark = pytest.mark.quick


def completed(*words):
    """The completions of the last word, as bash asks for them."""
    told = {"COMP_WORDS": " ".join(["indentfit", *words]), "COMP_CWORD": str(len(words)), "_INDENTFIT_COMPLETE": "bash_complete"}
    done = CliRunner().invoke(main, env=told, prog_name="indentfit")
    return [line.partition(",")[2] for line in done.output.splitlines() if line]


def test_keys_are_completed_in_every_command_that_sets_them():
    every = {f"{known.key}=" for known in keys()}
    context = click.Context(main)
    setting = 0
    for name in main.list_commands(context):
        for option in main.get_command(context, name).params:
            if "--set" in option.opts:
                assert {item.value for item in option.shell_complete(context, "")} == every, name
                setting += 1
    assert setting >= 9
    assert completed("fit", "--set", "sample.th") == ["sample.thickness="]


def test_values_of_a_key_with_choices_are_completed():
    assert "fit.method=least_squares" in completed("fit", "--set", "fit.method=")
    assert completed("simulate", "--set", "sample.thickness=") == []


def test_laws_are_completed_also_in_a_list():
    assert completed("init", "--material", "neo") == ["neo_hookean"]
    assert completed("compare", "--materials", "yeoh,neo") == ["yeoh,neo_hookean"]
    assert completed("materials", "mooney") == ["mooney_rivlin"]
