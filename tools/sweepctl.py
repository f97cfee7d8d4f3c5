"""Where ``sweepctl`` starts: Ctrl-C ends it in order from the first import on.

Starting takes a tenth of a second and more, nearly all of it imports.
"""

from __future__ import annotations

from tools.cli import interrupt


def main() -> None:
    """Entry point."""
    interrupt.install()
    from tools.cli.main import main as run

    interrupt.begin()
    run()


if __name__ == "__main__":
    main()
