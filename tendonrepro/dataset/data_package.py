"""Frictionless data packages, as svgdigitizer writes them: tables, and a JSON file with their units."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from tendonrepro.dataset.columns import Columns, Tables, Unreadable
from tendonrepro.dataset.text import read_text_table


def packaged(path: Path) -> dict[Path, dict[str, object]]:
    """Paths and descriptions of the tables of a frictionless data package; none of other files."""
    try:
        tree = json.loads(path.read_text(encoding="utf-8-sig"))
        resources = tree["resources"] if isinstance(tree, dict) else []
        return {
            path.parent / resource["path"]: resource
            for resource in resources
            if (path.parent / resource["path"]).is_file()
        }
    except (ValueError, KeyError, TypeError, OSError):
        return {}


def read_package(path: Path) -> Tables:
    """Read the tables of a frictionless data package, with the units of its fields.

    Raises
    ------
    Unreadable
        If a JSON file is none, or its tables are missing.
    """
    resources = packaged(path)
    if not resources:
        raise Unreadable("a JSON file that is no data package with a table beside it")
    tables = Tables()
    for table, resource in resources.items():
        fields = _fields(resource)
        cells = read_text_table(table)[""]
        name = str(resource.get("name") or table.stem)
        columns = Columns()
        columns.notes = cells.notes
        for column, values in cells.items():
            # A curve is called y where its figure does not say more; then the table's name tells.
            said = name if column.casefold() in ("y", "value") else column
            columns.add(said, values, fields.get(column, ""))
        tables["" if len(resources) == 1 and name == path.stem else name] = columns
    return tables


def _fields(resource: dict[str, object]) -> dict[str, str]:
    schema = resource.get("schema")
    listed: Sequence[object] = schema.get("fields", []) if isinstance(schema, dict) else []
    named = (field for field in listed if isinstance(field, dict) and "name" in field)
    return {str(field["name"]): str(field.get("unit") or "") for field in named}
