"""The command ``stimlib``: how its subcommands are defined, print and end."""

from __future__ import annotations

import errno
import inspect
import json
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import cache, partial, wraps
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import typer
from rich.console import Console
from typer.core import TyperCommand, TyperGroup

from ..errors import PUBLIC, StimlibError, shown
from ..system.progress import announce
from ..version import __version__

_UsageError: Any = typer.BadParameter.__base__


_PLAIN = {
    int: re.compile(r"-?[0-9]{1,18}").fullmatch,
    float: re.compile(r"-?([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]{1,2})?").fullmatch,
    Path: re.compile(r".+").fullmatch,
}
"""Texts of each kind that need no typer, unless the kind has a range."""


class _AsItIs:
    """Takes a text, a choice, a default value or nothing as it is; reads numbers.

    For all else it asks typer, whose import of pydantic takes 0.1 s.
    """

    def __init__(self, typers: Callable[[], Any]):
        self.typers = typers

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Convert a value, as typer calls it."""
        kind = param.type_descriptor.annotation
        same = type(value) is kind or (get_origin(kind) is Literal and value in get_args(kind))
        if same or (value is None and not param.multiple):
            return value
        if kind == list[str] and isinstance(value, list | tuple):
            return list(value)
        if (
            kind in _PLAIN
            and isinstance(value, str)
            and not param.type_descriptor.is_ranged
            and _PLAIN[kind](value)
        ):
            return kind(value)
        return self.typers().coerce(value, param=param, ctx=ctx)


_TAKES = {float: "NUMBER", int: "NUMBER", Path: "PATH", str: "TEXT", list[str]: "TEXT"}


class _Light:
    """A command whose parameters are converted by `_AsItIs`, where typer converts.

    The help has short words for what an option takes: typer's names of types leave its
    sentences 21 of 80 columns. A flag takes nothing.
    """

    def get_params(self, ctx: Any) -> Any:
        found = super().get_params(ctx)  # type: ignore[misc]
        for p in found:
            if p.param_type_name == "argument":
                p.display_type_rich = lambda ctx: None
            elif getattr(p, "is_flag", False):
                p.metavar = " "
            elif hasattr(p, "type_descriptor"):
                p._get_number_range_help_str = str  # '' for 0<=x<=65535 of a port
                p.metavar = p.metavar or _TAKES.get(p.type_descriptor.annotation, "WORD")
            if hasattr(p, "get_runtime_param") and "get_runtime_param" not in vars(p):
                p.get_runtime_param = partial(_AsItIs, p.get_runtime_param)
        return found


class _Command(_Light, TyperCommand):
    """A subcommand."""


class _Group(_Light, TyperGroup):
    """The group of subcommands, which reports parsing errors in one line."""

    def make_context(self, *args: Any, **options: Any) -> Any:
        with _in_one_line():
            return super().make_context(*args, **options)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the subcommand; refuse a second value of an option that takes one."""
        name, found, rest = super().resolve_command(ctx, args)
        words = [word.split("=")[0] for word in rest]
        once = [
            p for p in getattr(found, "params", ()) if not (getattr(p, "is_flag", 1) or p.multiple)
        ]
        if twice := [p.opts[0] for p in once if sum(map(words.count, p.opts)) > 1]:
            raise _UsageError(f"{twice[0]} is given twice, but takes one value; give it once", ctx)
        return name, found, rest

    def invoke(self, ctx: Any) -> Any:
        with _in_one_line():
            return super().invoke(ctx)


@contextmanager
def _in_one_line() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # typer would end with 1
        raise typer.Exit(141) from None
    except _UsageError as e:
        if type(e).__name__ == "NoArgsIsHelpError":  # typer has no public name for it
            raise
        text = " ".join(e.format_message().replace("Value error, ", "").split()).rstrip(".")
        text = re.sub(r"Input should be a valid (\w+).*", r"write a plain \1, such as 8", text)
        text = re.sub(
            r"No such option:? '?--html.*", "No such option: --html; write --report", text
        )
        if e.ctx and e.ctx.info_name == "list":
            text = re.sub(
                r"Got unexpected extra argument.*",
                "list takes no name; for one scene write stimlib show NAME",
                text,
            )
        text = f"{text}; see {e.ctx.command_path if e.ctx else 'stimlib'} --help"
        failed(text.replace(". Did you", "; did you").replace("?; see", "? See"))
        raise typer.Exit(2) from None


app = typer.Typer(
    cls=_Group, no_args_is_help=True, rich_markup_mode="rich", pretty_exceptions_show_locals=False
)
errors = Console(stderr=True, emoji=False)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"stimlib {__version__}")
        raise typer.Exit()


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
):
    """Compose, render, play, verify and list haptic stimuli."""


Command = Callable[..., Any]


def group(name: str, text: str) -> typer.Typer:
    """Return a new group of commands, such as ``experiment`` in ``experiment run``."""
    made = typer.Typer(cls=_Group, no_args_is_help=True, rich_markup_mode="rich", help=text)
    app.add_typer(made, name=name)
    return made


def command(name: str, of: typer.Typer = app, **shared: Command) -> Callable[[Command], Command]:
    """Turn a function into a subcommand with one-line errors and shared options.

    The options of the given functions are added to its own.
    """

    def made(function: Command) -> Command:
        options = {n for f in (function, *shared.values()) for n in inspect.signature(f).parameters}
        run = sharing(friendly(options)(function), shared)
        return of.command(name, cls=_Command, help=help_of(function))(run)

    return made


def help_of(function: Command) -> str:
    """Return the docstring of a command with a line for each paragraph.

    Typer would keep the line breaks of the source.
    """
    text = inspect.getdoc(function) or ""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def sharing(function: Command, shared: dict[str, Command]) -> Command:
    """Give a command the options (keyword-only parameters) of other functions.

    The command receives each of these functions with the options already filled in.
    """

    @wraps(function)
    def run(**given: Any) -> None:
        for name, f in shared.items():
            given[name] = partial(f, **{option: given.pop(option) for option in _options(f)})
        function(**given)

    takes: list[inspect.Parameter] = []
    for name, p in inspect.signature(function, eval_str=True).parameters.items():
        takes += (
            _options(shared[name]).values() if name in shared else [p.replace(kind=p.KEYWORD_ONLY)]
        )
    run.__signature__ = inspect.Signature(takes)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in takes}
    del run.__wrapped__  # or its annotations are read
    return run


def _options(f: Command) -> dict[str, inspect.Parameter]:
    return {
        n: p
        for n, p in inspect.signature(f, eval_str=True).parameters.items()
        if p.kind is p.KEYWORD_ONLY
    }


@contextmanager
def friendly(options: Collection[str] = ()) -> Iterator[None]:
    """Print warnings and usage errors in one line each, and set the exit status.

    Errors that begin with an argument of the command name its option instead.

    The status is 2 for usage errors, 130 for Ctrl-C, and 3, with a traceback, for a
    bug. If the reader of a pipe has gone, the status is 141, as for any command.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("default", RuntimeWarning)
            once = cache(note)  # the same words from two places are one warning
            warnings.showwarning = lambda message, *_, **__: once(str(message))
            announce[:] = [cache(say)]
            try:
                yield
            finally:
                announce.clear()
    except (typer.Exit, typer.Abort, BrokenPipeError):  # of which the group makes an end
        raise
    except StimlibError as e:
        failed(_of_options(str(e), options))
        raise typer.Exit(2) from None
    except KeyboardInterrupt as e:
        say(f"stopped; {shown(str(e) or 'nothing was left behind')}")
        raise typer.Exit(130) from None
    except Exception as e:
        if isinstance(e, OSError) and e.errno in (errno.ENOSPC, errno.EIO) and e.filename is None:
            failed(f"cannot write what is printed: {e.strerror}")
            raise typer.Exit(2) from None
        say(traceback.format_exc().rstrip())
        _line(
            "[bold red]unexpected error:[/]",
            f"{type(e).__name__}: {e}; this is a defect of stimlib, please report it",
        )
        raise typer.Exit(3) from None


def _of_options(text: str, options: Collection[str]) -> str:
    """Reword an error of a function in terms of command-line options.

    The message begins with the option instead of the names of function and argument.
    """
    while (found := re.match(r"(\w+): ", text)) and _inner(found[1]):
        text = text[found.end() :]
    text = re.sub(r"^set\('(\w+)', (.*?)\)", r"--set \1=\2", text)
    name = re.match(r"\w*", text)[0]  # type: ignore[index]
    if re.match(r"[/\\.-]", text[len(name) :]):  # the path of a file or folder
        return text
    if {name, f"{name}_"} & {*options}:
        return f"--{name.replace('_', '-')}{text[len(name) :]}"
    return text


def _inner(name: str) -> bool:
    """Return whether a function is internal and unknown to command-line users."""
    place = PUBLIC.get(name, "scenes")
    return not any(room in place for room in ("scenes", "blocks"))


# What is printed ----------------------------------------------------------------------
def failed(text: Any) -> None:
    """Print an error in one line on stderr."""
    _line("[bold red]error:[/]", text)


def note(text: Any) -> None:
    """Print a warning in one line on stderr."""
    _line("[bold yellow]note:[/]", text)


def _line(what: str, text: Any) -> None:
    errors.print(f"{what} ", end="")
    say(shown(text))


def say(text: Any, to: Console = errors) -> None:
    """Print a text as it is, by default on stderr."""
    to.print(text, markup=False, highlight=False, soft_wrap=True)


def print_json(data: Any) -> None:
    """Print data as JSON on stdout, for other programs."""
    print(json.dumps(data, indent=1, allow_nan=False))


def _reader_gone(self: Console) -> None:
    raise BrokenPipeError


# of every console, typer's own too: rich would end the process with status 1
Console.on_broken_pipe = _reader_gone  # type: ignore[method-assign]


def print_wide(data: Any) -> None:
    """Print a table or report on stdout, as wide as the terminal.

    Without a terminal, the width is 130 characters.
    """
    Console(width=None if sys.stdout.isatty() else 130, emoji=False).print(data)


def print_result(result: Any, json_: bool) -> None:
    """Print a report, or its data as JSON, on stdout."""
    if json_:
        print_json(result.to_dict())
    else:
        print_wide(result)


def end(passed: bool) -> None:
    """Exit with status 1 unless all checks passed."""
    if not passed:
        raise typer.Exit(1)
