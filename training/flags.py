"""Makes a command of a function: each parameter becomes a flag."""

import argparse
import inspect
from collections.abc import Callable
from typing import Annotated, Literal, get_args, get_origin


def run_command(function: Callable, line: list[str] | None = None) -> object:
    """Calls a function with the arguments of the command line.

    `--help` begins with the first line of the function's module.
    """
    parser = argparse.ArgumentParser(description=function.__globals__["__doc__"].splitlines()[0])
    add_flags(parser, function)
    return function(**vars(parser.parse_args(line)))


def add_flags(parser: argparse.ArgumentParser, function: Callable) -> None:
    """Adds a flag for each parameter of a function. The second part of `Annotated` is its help text."""
    for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
        kind, explanation = parameter.annotation, None
        if get_origin(kind) is Annotated:
            kind, explanation = get_args(kind)
        options = {"help": explanation, "default": parameter.default}
        if parameter.default is parameter.empty:
            options |= {"default": None, "required": True}
        if get_origin(kind) is Literal:
            options["choices"] = [value for value in get_args(kind) if value is not None]
        elif kind is bool:
            options["action"] = "store_true"
        elif get_origin(kind) is list:
            options |= {"type": get_args(kind)[0], "nargs": "+" if parameter.default else "*"}
        else:
            options["type"] = next(part for part in (*get_args(kind), kind) if part is not type(None))
        parser.add_argument(f"--{name.replace('_', '-')}", **options)
