"""Entry point of ``sweepctl``. It handles Ctrl-C from the first import on.

The start takes 0.1 s or more, mostly for imports.
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
