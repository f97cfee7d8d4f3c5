"""``sweepctl completion``: the completion script of a shell."""

from __future__ import annotations

import click

from tools.cli.console import write_lines

SHELLS = ("bash", "zsh", "fish")
VARIABLE = "_SWEEPCTL_COMPLETE"


@click.command(
    "completion",
    epilog='Example:  eval "$(sweepctl completion bash)"',
)
@click.argument("shell", type=click.Choice(SHELLS))
def command(*, shell: str) -> int:
    """Print the script by which SHELL completes commands, options, ports and message names.

    Write it where the shell looks for it:

    \b
    bash:  sweepctl completion bash > ~/.local/share/bash-completion/completions/sweepctl
    zsh:   sweepctl completion zsh > "${fpath[1]}/_sweepctl"
    fish:  sweepctl completion fish > ~/.config/fish/completions/sweepctl.fish
    """  # noqa: D301 - click keeps the lines of a block behind \b
    from click.shell_completion import get_completion_class

    from tools.cli.main import cli

    kind = get_completion_class(shell)
    assert kind is not None  # noqa: S101 - the choices are click's own
    made = kind(cli, {}, "sweepctl", VARIABLE)
    # Not source(), because it requires bash on this machine, and the script may be for another
    # machine.
    write_lines(made.source_template % made.source_vars() + "\n")
    return 0
