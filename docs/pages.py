"""Write the parts of pages that are made from the package: ``make pages``.

A part stands between ``<!-- made: NAME -->`` and ``<!-- end -->``; a test makes each again and compares.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tendonrepro.reporting import contents

DOCS = Path(__file__).parent
PART = re.compile(r"(<!-- made: ([\w ]+) -->\n).*?(<!-- end -->)", re.S)


def fresh(text: str, makers: Mapping[str, Callable[[], str]] | None = None) -> str:
    """A page with the parts made again that `makers` know, by default those of this file."""
    makers = makers or MAKERS
    return PART.sub(
        lambda part: f"{part[1]}\n{makers[part[2]]()}\n\n{part[3]}" if part[2] in makers else part[0], text
    )


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Pipe table."""
    escaped = ([cell.replace("|", r"\|") for cell in cells] for cells in (heads, ["---"] * len(heads), *rows))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in escaped)


def pairs() -> str:
    from tendonrepro.configuration.ensemble import load_ensemble

    return "\n".join(f"- `{'+'.join(pair)}`" for pair in load_ensemble(None).config.pairs)


def unprinted(
    wanted: Callable[[str, bool], bool], experiments: Sequence[str] = ("compare", "decouple")
) -> str:
    """Values of shipped experiments that the paper does not print, by key and whether all of them hold them."""
    from tendonrepro.configuration.load import load_config

    trees = [load_config(name, None).tree for name in experiments]
    keys = [dict(contents.quantities(tree)) for tree in trees]
    kept = [
        row
        for row in contents.value_rows(trees)
        if row[3] != "printed" and wanted(row[0].strip("`"), all(row[0].strip("`") in held for held in keys))
    ]
    return table(("Key", "Value", "Unit", "Origin", "Why"), kept)


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


def of_compare(key: str, both: bool) -> bool:
    return not both and not key.startswith(("manipulator.", "position_loop.", "runs.decouple", "runs.pull"))


def of_plain(key: str, _both: bool) -> bool:
    return key.startswith(("manipulator.", "posture", "reference", "disturbance"))


def of_decouple(key: str, both: bool) -> bool:
    return not both and key.startswith(("position_loop.", "runs.decouple", "runs.pull"))


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
    lines = [f"tendonrepro {name:{wide}}  {command.get_short_help_str(200)}" for name, command in held.items()]
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


def one_line() -> str:
    """A line of physics as tape, as instructions for eight experiments, as machine code, as JavaScript."""
    from llvmlite import binding

    from tendonrepro.simulation.codegen import machine, printed
    from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape

    def surface(de: Any, beta: Any, e: Any) -> Any:
        return de + beta * e

    tape, rows = LaneTape(), LaneRows()
    s = surface(*rows.variables(tape, "given", 3))
    lines = s.tape.lines
    (result,) = rows.take("s", 1)
    written = [
        f"{name} = {' '.join(map(str, (operation, *operands)))}"
        if operation == "row"
        else f"{name} = {operands[0]} {operation} {operands[1]}"
        for name, (operation, operands) in lines.items()
    ]
    source = machine.vector_code("surface", lines, {result: [*lines][-1]})
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    # A fixed processor, so that the page is the same wherever it is made.
    target = binding.Target.from_triple("x86_64-unknown-linux-gnu")
    assembly = target.create_target_machine(cpu="x86-64-v3", opt=3).emit_assembly(
        binding.parse_assembly(source)
    )
    instructions = [line.strip() for line in assembly.splitlines() if line.startswith("\tv")]
    places = printed.PlacesTape()
    value = surface(*places.places("given", 3))
    script = printed.function_source("surface", places.lines, {("found", 0): value}, ("given", "found"))
    return "\n\n".join(
        (
            code_block("", "\n".join(written)),
            "The same as LLVM's instructions. A row is eight numbers, one of each experiment:",
            code_block("llvm", source.strip()),
            "LLVM makes machine code of them. A processor with AVX2 takes four numbers at once, so there are two "
            "halves, and each product with its sum is one instruction:",
            code_block("asm", "\n".join(" ".join(line.split()) for line in instructions)),
            "The same tape as JavaScript, for [the page in a browser](tutorial.md#move-things-in-a-browser):",
            code_block("js", script),
        )
    )


def code_block(language: str, text: str) -> str:
    """Text in a fence."""
    return f"```{language}\n{text}\n```"


MAKERS: Mapping[str, Callable[[], str]] = {
    "one line": one_line,
    "the box": lambda: table(contents.BOX_HEADS, contents.box_rows()),
    "the readings": readings,
    "the keys": keys,
    "the pairs of readings": pairs,
    "the manipulator": lambda: unprinted(lambda key, _: key.startswith("manipulator.")),
    "both experiments": lambda: unprinted(lambda key, both: both and not key.startswith("manipulator.")),
    "the comparison": lambda: unprinted(of_compare),
    "the decoupling experiment": lambda: unprinted(of_decouple),
    "the plain arm": lambda: unprinted(of_plain, ("plain",)),
    "the commands": commands,
    "the options": options,
    "the variables of a trace": variables,
}


if __name__ == "__main__":
    for path in sorted(DOCS.glob("*.md")):
        path.write_text(fresh(path.read_text(encoding="utf-8")), encoding="utf-8")
