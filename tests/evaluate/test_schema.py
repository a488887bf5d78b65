"""The published schema of results.json holds for what is written."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.evaluate.comparison import KINDS
from coslobe.evaluate.metrics import METRICS

SCHEMA = json.loads((Path(__file__).parents[2] / "docs" / "results.schema.json").read_text())


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    Draft202012Validator.check_schema(SCHEMA)
    return Draft202012Validator(SCHEMA)


@pytest.mark.parametrize(
    "options", [["--frames", "0:2"], ["--sweep", "ti", "--values", "0,0.01", "--frames", "0"]]
)
def test_results_fit_the_schema(validator, ball_scene, tmp_path, options):
    arguments = ["eval", str(ball_scene), *options, "--spp", "4", "-o", str(tmp_path), "--json"]
    arguments += ["--set", "image.width=16", "--set", "image.height=12"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "results.json").read_text())
    validator.validate(document)
    document["format"] = "something/2"
    assert not validator.is_valid(document)


def test_every_metric_is_in_the_schema():
    part = SCHEMA["$defs"]["part"]["properties"]
    assert {f"{name}_{kind}" for name in METRICS for kind in KINDS} <= set(part)
    assert set(SCHEMA["$defs"]["metrics"]["properties"]) == set(METRICS)
