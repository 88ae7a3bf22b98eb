"""The command line: commands of Typer by their signatures, streams, errors and exit codes."""

from __future__ import annotations

import atexit
import inspect
import io
import json
import os
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Literal, TypeAlias, cast, get_args, get_origin

import typer
from typer import Option
from typer.core import TyperGroup

from tendonrepro import __version__
from tendonrepro.commands import AT_THE_TOP, COMMANDS, FORMER
from tendonrepro.console import Talk, columns, without_controls
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.files import to_json
from tendonrepro.studies.command import FILES, GROUPS, ONE_ARM, PANELS, Command, kinds_of, option_of, word_of
from tendonrepro.studies.study import Answer, Telling

OfClick: TypeAlias = Any
"""What writes help, a call, its command: of Click, or of the copy of it in newer versions of Typer."""

INTERRUPTED = 130
"""Exit code into which Typer turns an interrupt, without a word."""

EPILOG = (
    "Exit codes: 0 done, 1 error, 2 usage or configuration, 3 a verdict is against the paper "
    "(claims --check), 4 data missing or not reachable, 5 a run diverged, 130 interrupted."
)

HELP = """Reproduce Yan et al., Actuators 2026, 15(5), 271: kinematic decoupling and α-TDE-NTSM control.

Begin with "tendonrepro reproduce", then "tendonrepro claims" for the verdict on what the paper says."""


class FirstScreen(TyperGroup):
    """Lists commands by panels, and says what became of those that went."""

    def format_commands(self, ctx: object, formatter: OfClick) -> None:
        """Write a section for each panel."""
        del ctx
        shown = {name: entry for name, entry in self.commands.items() if not entry.hidden}
        widest = formatter.width - 6 - max(map(len, shown))
        for panel in PANELS:
            of_panel = {name: entry for name, entry in shown.items() if entry.rich_help_panel == panel}  # type: ignore[attr-defined]
            with formatter.section(panel):
                formatter.write_dl([(n, entry.get_short_help_str(widest)) for n, entry in of_panel.items()])

    def resolve_command(self, ctx: OfClick, args: list[str]) -> OfClick:
        """Refuse the words of a command that has others now."""
        if args[0] in FORMER and not ctx.resilient_parsing:
            message = f"{args[0]!r} is now {FORMER[args[0]]!r}"
            raise UsageError(message, hint=f"type tendonrepro {FORMER[args[0]]}")
        return super().resolve_command(ctx, args)


RETIRED = {
    "device": "leave it out: everything runs on processors, and --jobs says on how many",
    "from-draws": "leave it out: searches begin at the nearest of their own samples; "
    "for those of another arm name an ensemble with that base as --config",
    **dict.fromkeys(
        ("generations", "population", "seeds"),
        "identify has --budget, the number of plants of each of its two searches",
    ),
    "unknowns": "leave it out: identify searches all that can vary, or what --rows names",
}
"""Options of the last version that are gone, and what to do instead."""

app = typer.Typer(
    cls=FirstScreen,
    help=HELP,
    epilog=EPILOG,
    rich_help_panel=ONE_ARM,
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


_DRY_RUN = Annotated[bool, typer.Option("--dry-run", help="Check everything, run nothing.")]

TERMINAL: dict[str, object] = {
    "as_json": Annotated[bool, typer.Option("--json", help="Print one JSON object.")],
    "quiet": Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")],
    "verbose": Annotated[bool, typer.Option("--verbose", "-v", help="Say more; with reproduce, all tables.")],
}
"""Options of every command."""


def add_command(app: typer.Typer, command: Command, *, hidden: bool = False) -> None:
    """Give a command to the command line: parse, call its function, print the answer."""
    own, about = command.signature.parameters, command.help
    options = [_option(given, about.get(name, "")) for name, given in own.items() if not _is_talk(given)]
    options += [_keyword("dry_run", False, _DRY_RUN)] if command.has_dry_run else []
    options += [_keyword(name, False, annotation) for name, annotation in TERMINAL.items()]

    def run(**words: object) -> int:
        as_json, quiet, verbose = (bool(words.pop(name)) for name in TERMINAL)
        answer = _answer(command, words, Talk(quiet=quiet, verbose=verbose))
        show(answer, as_json=as_json, quiet=quiet)
        return answer.exit_code

    run.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in options}
    run.__doc__ = command.about
    epilog = f"Example: {command.words(*command.example.args, **command.example.kwargs)}"
    app.command(command.word, epilog=epilog, rich_help_panel=command.under, hidden=hidden)(run)


def _answer(command: Command, words: Mapping[str, object], talk: Talk) -> Answer[object]:
    """Call the function of a command with what the command line gave."""
    positional: Sequence[object] = ()
    keywords: dict[str, object] = {}
    for name, parameter in command.signature.parameters.items():
        if _is_talk(parameter):
            keywords[name] = talk
        elif parameter.kind is parameter.VAR_POSITIONAL:
            positional = cast("Sequence[object]", words[name] or ())
        elif words[name] is not None:
            # The flag of what holds by default says that it shall not.
            keywords[name] = not words[name] if parameter.default is True else words[name]
    prepared = command.prepare(*positional, **keywords)
    if isinstance(prepared, Answer):
        return prepared
    from tendonrepro.studies.lifecycle import carry_out

    return carry_out(prepared, talk, dry_run=bool(words.get("dry_run")))


def show(answer: Answer[object], *, as_json: bool, quiet: bool) -> None:
    """Print an answer as JSON, or in words; these are on standard output, notes on standard error."""
    if as_json:
        typer.echo(without_controls(to_json(dict(answer.data))), nl=False)
    elif not quiet:
        typer.echo(without_controls(answer.text))


def _is_talk(parameter: inspect.Parameter) -> bool:
    return bool(parameter.annotation == Telling)


def _keyword(name: str, default: object, annotation: object) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _option(parameter: inspect.Parameter, about: str) -> inspect.Parameter:
    """A parameter of a public function as Typer wants it."""
    word, kind, default = word_of(parameter.annotation), _writable(parameter.annotation), parameter.default
    many = parameter.kind is parameter.VAR_POSITIONAL
    if many:
        kind = GenericAlias(list, (kind,))
    if many or default in (None, ()):
        kind, default = kind | None, None
    metavar = word.metavar or None
    if many or word.positional:
        return _keyword(parameter.name, default, Annotated[kind, typer.Argument(help=about, metavar=metavar)])
    if get_origin(_writable(parameter.annotation)) is list:
        about = f"{about.removesuffix('.')}; repeatable."
    option = typer.Option(option_of(parameter), help=about, metavar=metavar)
    # The flag of what holds by default says that it shall not.
    return _keyword(parameter.name, False if default is True else default, Annotated[kind, option])


def _writable(annotation: object) -> Any:
    """The type by which the command line gives a value: of a union, the first that it can write."""
    for kind in kinds_of(annotation):
        if get_origin(kind) is Sequence:
            return GenericAlias(list, get_args(kind))
        if kind in (bool, int, float, str, Path) or get_origin(kind) is Literal:
            return kind
    raise TypeError(annotation)


def _help_if_alone(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _add_commands() -> None:
    """Commands on the first screen, groups behind them."""
    groups = {name: typer.Typer(help=about, invoke_without_command=True) for name, about in GROUPS.items()}
    for entry in sorted(COMMANDS.values(), key=lambda entry: [*PANELS, *GROUPS].index(entry.under)):
        add_command(groups.get(entry.under, app), entry)
    for name, group in groups.items():
        group.callback()(_help_if_alone)
        app.add_typer(group, name=name, rich_help_panel=FILES)
    for entry in COMMANDS.values():
        if entry.word in AT_THE_TOP:
            add_command(app, entry, hidden=True)


_add_commands()


@app.callback()
def _root(
    context: typer.Context,
    version: Annotated[bool, Option("--version", help="Print the version.")] = False,
    verbose: Annotated[bool, Option("--verbose", "-v", help="With --version: the environment, too.")] = False,
    cite: Annotated[bool, Option("--cite", help="Print BibTeX of paper and software.")] = False,
) -> None:
    if version:
        typer.echo(_environment() if verbose else __version__)
        raise typer.Exit
    if cite:
        text = files("tendonrepro.cli").joinpath("citation.bib").read_text(encoding="utf-8")
        typer.echo(text.rstrip().replace("VERSION", __version__))
        raise typer.Exit
    if verbose:
        raise UsageError("--verbose stands behind a command, or after --version")
    _help_if_alone(context)


def _environment() -> str:
    """Versions and machine, as a manifest has them."""
    from tendonrepro.results.store import environment

    here = environment()
    git = here["git"] or {"commit": "not a checkout", "dirty": False}
    rows = {
        "tendonrepro": __version__,
        "git": git["commit"] + (" (changed)" if git["dirty"] else ""),
        "python": here["python"],
        "platform": here["platform"],
        "cpu": f"{here['cpu']} x {here['cpu_count']}",
        **here["versions"],
    }
    return columns(rows.items())


def _keep_settings_of_matplotlib() -> None:
    """Name one folder for all processes where the home cannot be written: else each leaves one behind."""
    home = os.environ.get("XDG_CONFIG_HOME") or os.path.expanduser("~")  # noqa: PTH111 (Path raises where nobody has one)
    if "MPLCONFIGDIR" not in os.environ and not os.access(home, os.W_OK):
        os.environ["MPLCONFIGDIR"] = folder = tempfile.mkdtemp()
        atexit.register(shutil.rmtree, folder, ignore_errors=True)


def main() -> None:
    """Run the command line and leave with its exit code."""
    _open_streams()
    # Matrices are small: threads of the library would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Commands draw to files. A notebook names a backend here that another environment may not have.
    os.environ.pop("MPLBACKEND", None)
    _keep_settings_of_matplotlib()
    try:
        _refuse_empty(sys.argv[1:])
        code = app(standalone_mode=False) or 0
    except TendonreproError as error:
        code = _fail(error.exit_code, error.message, error.where, error.hint)
    except BrokenPipeError:
        # Whoever read the output has seen enough.
        code = 1
    except OSError as error:
        place = error.filename and str(error.filename)
        code = _fail(1, f"the system refused: {error.strerror}", place, "look at permissions and free space")
    except Exception as error:
        if _of_an_interrupt(error):
            code = INTERRUPTED
        # Typer's errors of usage have no class that it exports.
        elif hasattr(error, "format_message"):
            code = _fail(2, error.format_message(), None, _help_for(error))
        else:
            raise
    if code == INTERRUPTED:
        # What is left is to end, which another interrupt would only fill with tracebacks.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _fail(code, "interrupted", None, None)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            # A closed pipe: Python would try once more at its end, and leave with an exit code of its own.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(code)


def _of_an_interrupt(error: BaseException | None) -> bool:
    """Say whether an interrupt is behind it: a compiled module, interrupted at import, raises ImportError."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _open_streams() -> None:
    """Open closed standard streams, whose place the next file would take; let any character pass."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # The lowest number that is free is that of the stream. Worker processes need it too.
            null = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(null, True)
            setattr(sys, name, os.fdopen(null, mode, encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _refuse_empty(words: Sequence[str]) -> None:
    """An empty word, as of an unset shell variable, would mean the current folder."""
    for word in words:
        if re.fullmatch("(--[a-z-]+=)?", word):
            raise UsageError(f"{word or 'an argument'} is empty", hint="name a file, a folder or a value")


def _help_for(error: Exception) -> str:
    """Which help tells of a wrong word: that of its command, or of all."""
    names: list[str] = []
    context: Any = getattr(error, "ctx", None)
    while context is not None and context.parent is not None:
        names.insert(0, str(context.info_name))
        context = context.parent
    command, option = " ".join(names), str(getattr(error, "option_name", "")).removeprefix("--")
    if option in RETIRED:
        return RETIRED[option]
    return (
        f"tendonrepro {command} --help shows what it takes" if names else "tendonrepro --help lists commands"
    )


def _fail(code: int, message: str, where: str | None, hint: str | None) -> int:
    """Tell of an error, as JSON where asked for, and return its code."""
    error = {"code": code, "message": message, "where": where, "hint": hint}
    head = f"{where}: {message}" if where else message
    with suppress(OSError):
        if "--json" in sys.argv:
            typer.echo(without_controls(json.dumps({"error": error}, ensure_ascii=False)))
        else:
            typer.echo(without_controls("\n".join(["error: " + head, *([hint] if hint else [])])), err=True)
    return code
