"""The program: ``brushexp photo.jpg``, which is ``python -m brushexp photo.jpg`` and ``python run.py photo.jpg``."""

import gc
import sys
import time


def main() -> None:
    """Do what the command line says; ``--help`` shows the choices."""
    start = time.monotonic()  # before the slow imports, which count
    gc.disable()  # until the task begins: modules are no garbage, and to look for it takes a seventh of the start
    from brushexp.cli.opening import open_with  # noqa: PLC0415
    from brushexp.system.heartbeat import heartbeat  # noqa: PLC0415

    try:
        sys.argv[1:] = open_with(sys.argv[1:])  # before the seconds that the next line takes
        from brushexp.cli.program import run  # noqa: PLC0415

        run(start)
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        heartbeat.end()


if __name__ == "__main__":
    main()
