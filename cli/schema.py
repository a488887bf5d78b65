"""`coslobe schema`: the scene file described for editors."""

from coslobe.cli.common import command, print_json


@command
def schema() -> None:
    """Print the JSON schema of scene files; editors complete and check with it."""
    from coslobe.render.scene import Description

    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **Description.model_json_schema()})
