"""The command `filterbench`; `python -m suite` is the same."""

import sys


def main() -> int:
    """Run the command line of this process; an interrupt while modules are still being imported is told like any other."""
    try:
        from suite import cli
    except KeyboardInterrupt:
        print("filterbench: interrupted before anything was run", file=sys.stderr)
        return 130
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
