"""The command: `gpugi render cornell -o cornell.png`, or `python -m gpugi render ...`."""

import signal
import sys

from gpugi import _gpugi


def main() -> None:
    """Runs the command with the arguments of this process."""
    # The command has its own way to stop at Ctrl-C.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_gpugi.command(["gpugi", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
