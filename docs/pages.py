"""Write the parts of pages that are made from the package: ``make pages``.

A part stands between ``<!-- made: NAME -->`` and ``<!-- end -->``. Of a long table a page has some rows, between
``<!-- site: NAME -->`` and ``<!-- end -->``, and the site has all. A test makes each part again and compares.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tendonrepro.reporting import contents

DOCS = Path(__file__).parent
PART = re.compile(r"(?P<head><!-- (?P<kind>made|site): (?P<name>[\w ]+) -->\n)(?P<shown>.*?)(?P<end><!-- end -->)", re.S)
Makers = Mapping[str, Callable[[], str]]


def fresh(text: str, makers: Makers | None = None) -> str:
    """A page with the parts made again that `makers` know, by default those of this file."""
    return _filled(text, makers or MAKERS, lambda part, made: excerpt(part["shown"], made) if part["kind"] == "site" else made)


def of_site(text: str, makers: Makers) -> str:
    """A page whose long tables are whole."""
    return _filled(text, makers, lambda part, made: made if part["kind"] == "site" else part["shown"].strip())


def _filled(text: str, makers: Makers, filling: Callable[[re.Match[str], str], str]) -> str:
    def filled(part: re.Match[str]) -> str:
        if part["name"] not in makers:
            return part[0]
        return f"{part['head']}\n{filling(part, makers[part['name']]())}\n\n{part['end']}"

    return PART.sub(filled, text)


def excerpt(shown: str, whole: str) -> str:
    """Those lines of a table whose first cell is shown."""
    kept = set(map(_first_cell, shown.splitlines()))
    return "\n".join(line for line in whole.splitlines() if _first_cell(line) in kept)


def _first_cell(line: str) -> str:
    return line.removeprefix("|").partition("|")[0].strip()


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Pipe table."""
    escaped = ([cell.replace("|", r"\|") for cell in cells] for cells in (heads, ["---"] * len(heads), *rows))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in escaped)


def unprinted(*experiments: str) -> str:
    """Values of shipped experiments that the paper does not print."""
    from tendonrepro.configuration.load import load_config

    rows = contents.value_rows([load_config(name, None).tree for name in experiments])
    return table(("Key", "Value", "Unit", "Origin", "Why"), [row for row in rows if row[3] != "printed"])


def readings() -> str:
    """Places of the paper that can be read in more than one way."""

    from tendonrepro.configuration.models.control import RUNS, Readings
    from tendonrepro.configuration.models.readings import AXES

    def runs(affects: Mapping[str, tuple[str, ...]]) -> str:
        named = {value: "all" if held == RUNS else ", ".join(held) for value, held in affects.items()}
        each = [f"{value}: {held}" for value, held in named.items()]
        return named.popitem()[1] if len(set(named.values())) == 1 else "; ".join(each)

    rows = []
    for axis in AXES.values():
        key = f"`control.readings.{axis.name}`" if axis.name in Readings.model_fields else f"`{axis.name}`"
        rows.append(
            (key, axis.printed, ", ".join(axis.alternatives), runs(axis.affects), axis.at.place, axis.about)
        )
    return table(("Reading", "Default", "Alternatives", "Changes the runs", "Place", "About"), rows)


def keys() -> str:
    """Every key of experiments and arm as the schema has it; readings have a table of their own."""
    from tendonrepro.configuration.any_kind import json_schema

    rows: dict[str, tuple[str, str]] = {}
    for kind, above in (("compare", ()), ("decouple", ()), ("manipulator", ("manipulator",))):
        schema = json_schema(kind)
        for path, about, unit in fields(schema, schema["$defs"], above):
            if about and not path.startswith("control.readings"):
                rows.setdefault(path, (about, unit))
    return table(("Key", "Meaning", "Unit"), [(f"`{key}`", *row) for key, row in rows.items()])


def fields(
    node: Mapping[str, Any], defs: Mapping[str, Any], path: tuple[str, ...]
) -> Iterator[tuple[str, str, str]]:
    """Keys below a node of a schema, each with its meaning and unit."""
    node = next((one for one in node.get("anyOf", ()) if "properties" in one), node)
    node = defs[node["$ref"].rpartition("/")[2]] | node if "$ref" in node else node
    inside = node.get("properties", {})
    if inside and "value" not in inside:
        for key, below in inside.items():
            yield from fields(below, defs, (*path, key))
    else:
        about, _, unit = node.get("description", "").partition("; unit ")
        kinds = node.get("discriminator", {}).get("mapping", ())
        choices = ", ".join(f"`{choice}`" for choice in node.get("enum", kinds))
        yield ".".join(path), ": ".join(filter(None, (about, choices))), unit or "–"


def shown_commands() -> dict[str, Any]:
    """Commands by the words that call them, those of a group behind the others."""
    from typer.main import get_command

    from tendonrepro.cli.app import app

    tree: Any = get_command(app)
    top = {name: command for name, command in tree.commands.items() if not command.hidden}
    groups = {name: top.pop(name) for name in [*top] if hasattr(top[name], "commands")}
    inner = {
        f"{name} {word}": command for name, group in groups.items() for word, command in group.commands.items()
    }
    return top | inner


def commands() -> str:
    held = shown_commands()
    wide = max(map(len, held))
    lines = [f"{name:{wide}}  {command.get_short_help_str(200)}" for name, command in held.items()]
    return "\n".join(["```", *lines, "```"])


def options() -> str:
    """Every option of every command; what many have in common stands once."""
    tree = shown_commands()
    held: dict[tuple[str, str], list[str]] = {}
    for name, command in tree.items():
        for option in command.params:
            shown = ", ".join(f"`{word}`" for word in option.opts)
            held.setdefault((shown, option.help or ""), []).append(name)

    def of(names: Sequence[str]) -> str:
        others = [name for name in tree if name not in names]
        if not others:
            return "all"
        few = len(others) < len(names) / 2
        return "all but " * few + ", ".join(f"`{name}`" for name in (others if few else names))

    rows = sorted(held.items(), key=lambda item: -len(item[1]))
    return table(("Option", "Meaning", "Of"), [(*option, of(names)) for option, names in rows])


def variables() -> str:
    from tendonrepro.results.records import VARIABLES

    rows = [(f"`{name}`", unit, about) for name, (unit, about) in VARIABLES.items()]
    return table(("Name", "Unit", "Meaning"), rows)


MAKERS: Makers = {
    "the box": lambda: table(contents.BOX_HEADS, contents.box_rows()),
    "the readings": readings,
    "the keys": keys,
    "the values": lambda: unprinted("compare", "decouple"),
    "the plain arm": lambda: unprinted("plain"),
    "the commands": commands,
    "the options": options,
    "the variables of a trace": variables,
}


if __name__ == "__main__":
    for path in sorted(DOCS.glob("*.md")):
        path.write_text(fresh(path.read_text(encoding="utf-8")), encoding="utf-8")
