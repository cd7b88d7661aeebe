"""Command-line entry point: ``brushexp photo.jpg`` or ``python -m brushexp photo.jpg``."""

import gc
import sys
import time


def main() -> None:
    """Run the program with the arguments in `sys.argv`."""
    start = time.monotonic()  # before the slow imports, so that their time counts
    gc.disable()  # until the task begins: modules are not garbage, and collecting takes a seventh of the startup time
    from brushexp.cli.opening import open_with  # noqa: PLC0415
    from brushexp.system.heartbeat import heartbeat  # noqa: PLC0415

    try:
        sys.argv[1:] = open_with(sys.argv[1:])  # before the next import, which takes seconds
        from brushexp.cli.program import run  # noqa: PLC0415

        run(start)
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        heartbeat.end()


if __name__ == "__main__":
    main()
