"""`indentfit predict`: the force that a fit predicts of another depth or indenter, with its bands."""

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.progress import progress


@click.command(cls=Command, short_help="Predict another test from a fit, with bands.")
@click.argument("result", type=click.Path())
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(result: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """Predict the forces of other tests from the result folder RESULT of a fit with [fit.discrepancy].

    --set says what is other: --set test.press.depth=2, --set indenter.radius=1. Bands hold 95 %: by the parameters, the inputs, the
    misfit of the law and the noise.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.report.folder import json_text
    from indentfit.report.schema import fit_with_case
    from indentfit.study.predict import predict

    fitted, case = fit_with_case(result, overrides)
    with progress("predict", total=1) as step:
        predicted = predict(fitted, case, step)
    click.echo(json_text(predicted.as_json()) if as_json else predicted.summary())
