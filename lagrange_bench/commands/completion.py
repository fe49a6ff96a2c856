"""Shell completion: scripts made from the parser itself, so that they know every command and option it has.

Written by hand and not by a library: what is completed here are words that depend on the word before, and nothing
else; that is less than it would take to teach a library the names of methods and tops. Zsh runs the script of bash.
"""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator
from typing import Any

from experiments import EXPERIMENTS
from lagrange_bench.text import Answer

Commands = dict[str, argparse.ArgumentParser]

SUMMARY = "completion for bash, zsh or fish"

DESCRIPTION = """\
Print a script that lets the shell complete commands, options, experiments, methods, tops and potentials."""


EXAMPLES = """\
examples:
  eval "$(lagrange-bench completion bash)"      for this shell; into ~/.bashrc for every one
  lagrange-bench completion zsh > ~/.lagrange-bench.zsh     and `source ~/.lagrange-bench.zsh` after compinit
  lagrange-bench completion fish > ~/.config/fish/completions/lagrange-bench.fish

The names are those of today: print it again after you installed a plug-in."""


BASH = """\
_lagrange_bench() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} words
  case "${{COMP_WORDS[1]}} $before" in
{values}
  *) case "$COMP_CWORD ${{COMP_WORDS[1]}} ${{current:0:1}}" in
    "1 "*) words={commands} ;;
{options}
{operands}
    *) return ;;
    esac ;;
  esac
  COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _lagrange_bench lagrange-bench"""


def run(options: argparse.Namespace) -> Answer:
    """The script of one shell."""
    script = {"bash": _bash, "zsh": _zsh, "fish": _fish}[options.shell](commands(options.parser))
    return Answer(script, {"shell": options.shell, "script": script})


def commands(parser: argparse.ArgumentParser) -> Commands:
    """The parser of each command."""
    (found,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return dict(found.choices)


def words(action: argparse.Action) -> list[str]:
    """What may follow an option, or stand where an operand is asked for; none: files, or what nobody can guess."""
    from integrators import METHODS, PERTURBED_TOPS, POTENTIALS, TOPS

    known: dict[str, Any] = {"method": METHODS, "kernels": METHODS, "experiments": EXPERIMENTS}
    known |= {"top": (*TOPS, *PERTURBED_TOPS), "potential": POTENTIALS}
    return [str(word) for word in action.choices or known.get(action.dest, ())]


def _actions(command: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    return (action for action in command._actions if action.help != argparse.SUPPRESS)


def _bash(found: Commands) -> str:
    values, options, operands = [], [], []
    for name, command in found.items():
        flags = [flag for action in _actions(command) for flag in action.option_strings if flag.startswith("--")]
        options.append(f'    *" {name} -") words={shlex.quote(" ".join(flags))} ;;')
        for action in _actions(command):
            given = shlex.quote(" ".join(words(action)))
            if action.option_strings and action.nargs != 0:
                pattern = "|".join(f'"{name} {flag}"' for flag in action.option_strings)
                values.append(f"  {pattern}) words={given} ;;")
            elif not action.option_strings and words(action):
                operands.append(f'    *" {name} "*) words={given} ;;')
    parts = {"values": values, "options": options, "operands": operands}
    text = {key: "\n".join(lines) for key, lines in parts.items()}
    return BASH.format(commands=shlex.quote(" ".join([*found, "--help", "--version"])), **text)


def _zsh(found: Commands) -> str:
    return f"autoload -Uz bashcompinit && bashcompinit\n{_bash(found)}"


def _fish(found: Commands) -> str:
    lines = [f"complete -c lagrange-bench -n __fish_use_subcommand -xa {shlex.quote(name)}" for name in found]
    for name, command in found.items():
        head = f"complete -c lagrange-bench -n '__fish_seen_subcommand_from {name}'"
        for action in _actions(command):
            flags = "".join(f" -l {flag[2:]}" for flag in action.option_strings if flag.startswith("--"))
            given = f" -xa {shlex.quote(' '.join(words(action)))}" if words(action) else " -r" * (action.nargs != 0)
            if flags:
                lines.append(f"{head}{flags}{given}")
            elif words(action):
                lines.append(f"{head} -a {shlex.quote(' '.join(words(action)))}")
    return "\n".join(lines)


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish")
