"""The published JSON Schemas are those of the records, and files of runs follow them."""

import json

import pytest
from pydantic import TypeAdapter

from identify.residual.comparison import Comparison
from palpmap.schemas import RECORDS, schemas, write_schemas
from tests.paths import ROOT


def contract(schema):
    """A schema but for its classes' own prose, which changes nothing in a file."""
    if isinstance(schema, dict):
        prose = {"description"} if "properties" in schema else set()
        return {key: contract(value) for key, value in schema.items() if key not in prose}
    return [contract(value) for value in schema] if isinstance(schema, list) else schema


def test_the_published_schemas_are_those_of_the_records(tmp_path):
    write_schemas(tmp_path)
    published, made = (
        {path.name: contract(json.loads(path.read_text())) for path in folder.iterdir()}
        for folder in (ROOT / "docs" / "schema", tmp_path)
    )
    assert published == made, "python -m palpmap.schemas docs/schema"


@pytest.mark.parametrize("name", ["fit", "result", "run"])
def test_a_file_of_a_run_is_its_record(explained_case, name):
    path = explained_case.folder / f"{name}.json"
    assert RECORDS[name].read(path).to_dict() == json.loads(path.read_text())


def covers(now, was) -> bool:
    """Whether a record has all that an earlier version wrote, with the same values."""
    if isinstance(was, dict):
        return all(key in now and covers(now[key], value) for key, value in was.items())
    if isinstance(was, list):
        return len(now) == len(was) and all(map(covers, now, was))
    return now == was


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "data" / "records").iterdir()))
def test_files_of_an_earlier_version_are_read(path):
    """Written by version 0.1, before the records were models."""
    assert covers(RECORDS[path.stem].read(path).to_dict(), json.loads(path.read_text()))


def test_a_comparison_follows_its_schema(explained_case):
    written = json.loads((explained_case.folder / "comparison.json").read_text())
    assert set(written) == set(schemas()["comparison"]["properties"])
    again = TypeAdapter(Comparison).validate_python(written)
    assert json.loads(json.dumps(again.to_dict())) == written


def test_every_number_with_a_unit_says_so():
    """A field whose name ends in a unit needs no words, every other number has a description."""
    bare = [
        f"{name}: {kind}.{key}"
        for name, schema in schemas().items()
        for kind, one in {name: schema, **schema.get("$defs", {})}.items()
        for key, field in one.get("properties", {}).items()
        if field.get("type") == "number"
        and "description" not in field
        and "description" not in one
        and not key.endswith(("_m", "_n", "_s", "_pa", "_hz"))
    ]
    assert bare == []
