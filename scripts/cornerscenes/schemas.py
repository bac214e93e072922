"""JSON Schemas of families, suites and libraries, with which editors complete and check them."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel

from cornerscenes.library import Backgrounds, Lights, Materials
from cornerscenes.recipes import Family, Suite
from cornerscenes.tables import schema_of

KINDS = {
    "family": Family,
    "suite": Suite,
    "materials": Materials,
    "backgrounds": Backgrounds,
    "lights": Lights,
}


def schema_text(kind: type[BaseModel]) -> str:
    """Return the schema of a kind of recipe, as its file has it."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema_of(kind)}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def write_schemas(program: str, kinds: Mapping[str, type[BaseModel]]) -> int:
    """Write the schemas of recipes into the folder that the command line names."""
    parser = argparse.ArgumentParser(prog=program, description=write_schemas.__doc__)
    parser.add_argument("folder", type=Path, help="where KIND.json is written")
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, kind in kinds.items():
        (folder / f"{name}.json").write_text(schema_text(kind), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(write_schemas("cornerscenes.schemas", KINDS))
