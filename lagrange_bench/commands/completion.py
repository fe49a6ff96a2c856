"""Completion for bash, zsh or fish.

Print a script that lets the shell complete commands, options, experiments, figures, methods, tops and potentials.

examples:
  eval "$(lagrange-bench completion bash)"      for this shell; into ~/.bashrc for every one
  lagrange-bench completion zsh > ~/.zsh/_lagrange-bench     in a folder of $fpath, before compinit
  lagrange-bench completion fish > ~/.config/fish/completions/lagrange-bench.fish

The names are those of today, and the figures those of the pages that were drawn: print the script again after you
installed a plug-in.
"""

import argparse
from typing import Any

from lagrange_bench.arguments import location
from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.output import Answer


def run(options: argparse.Namespace) -> Answer:
    """The script of one shell."""
    import shtab

    (commands,) = (a for a in options.parser._actions if isinstance(a, argparse._SubParsersAction))
    known = names()
    for command in commands.choices.values():
        for action in command._actions:
            if action.choices is None and action.dest in known:
                action.choices = known[action.dest]
            if action.type is location:
                action.complete = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE  # type: ignore[attr-defined]
    script = shtab.complete(options.parser, options.shell)
    return Answer(script, {"shell": options.shell, "script": script})


def names() -> dict[str, list[str]]:
    """What may be given for an option or operand, by its name in the parser."""
    from lagrange_bench.integrators.registry import METHODS, NAMED_TOPS, POTENTIALS
    from lagrange_bench.results.store import default_results

    results = default_results(), *default_results("quick").parent.glob("*")
    figures = sorted({path.stem for folder in results for path in folder.glob("page/figures/*.svg")})
    tops, methods = list(NAMED_TOPS), list(METHODS)
    found: dict[str, Any] = {"method": methods, "methods": methods, "highlight": methods}
    found |= {"top": tops, "tops": tops, "potential": list(POTENTIALS)}
    return found | {"experiments": list(EXPERIMENTS), "name": figures or None}


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish")
