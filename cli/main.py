"""The `coslobe` command: one file per sub-command in this folder, gathered here."""

import typer

from coslobe.cli import check, demo, devices, evaluate, reference, render, schema, spheres, tables
from coslobe.core.version import VERSION

app = typer.Typer(
    help="Noise-free soft shadows and glossy direct light from cosine lobes, sphere sets and bit masks.",
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"coslobe {VERSION}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Options before the command."""


app.add_typer(tables.app, name="tables")
app.command()(spheres.spheres)
app.command()(render.render)
app.command()(reference.reference)
app.command("eval")(evaluate.evaluate)
app.command()(check.check)
app.command()(schema.schema)
app.command()(devices.devices)
app.command()(demo.demo)


def main() -> None:
    """Entry point of the console script."""
    app()
