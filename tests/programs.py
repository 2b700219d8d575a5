"""The two programs' real command lines, down to the last action."""

import argparse
from collections.abc import Iterator
from functools import cache

from calib.station.app import COMMANDS, build_parser
from edge.app import _parser

Words = tuple[str, ...]


@cache
def parsers() -> dict[Words, argparse.ArgumentParser]:
    """Every parser by the words that lead to it: ("base-station", "survey", "enter")."""
    return dict([*_below(("base-station",), build_parser(*COMMANDS)), *_below(("edge-node",), _parser())])


def _below(words: Words, parser: argparse.ArgumentParser) -> Iterator[tuple[Words, argparse.ArgumentParser]]:
    yield words, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from _below((*words, name), inner)


def options(words: Words) -> set[str]:
    """What may stand behind these words: the options of their parser and of those that lead to it."""
    led = [parsers()[words[: k + 1]] for k in range(len(words))]
    return {option for parser in led for option in parser._option_string_actions}


def actions(words: Words) -> set[str]:
    """The subcommands or actions below these words."""
    return {known[len(words)] for known in parsers() if len(known) > len(words) and known[: len(words)] == words}
