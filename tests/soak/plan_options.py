"""The command line of a script whose plan is a dataclass: an option for each of its fields."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def plan_parser(description: str | None, plan: DataclassInstance) -> argparse.ArgumentParser:
    """A parser with an option for each field, whose default is the plan's."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawTextHelpFormatter
    )
    for name, value in asdict(plan).items():
        option = "--" + name.replace("_", "-")
        parser.add_argument(option, type=type(value), default=value, metavar="N")
    return parser
