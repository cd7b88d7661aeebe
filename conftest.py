"""Set up pytest without slow imports in the process that only distributes tests to worker processes."""

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Import the fixtures only where tests are run or listed; the fixtures' plugin also sorts the tests."""
    if config.option.dist == "no" or config.option.collectonly:
        config.pluginmanager.import_plugin("shared_fixtures")
    if getattr(config, "workerinput", {}).get("workerid") == "gw1":
        config.args.reverse()  # of two processes each compiles half of the tests, and loads what the other has compiled
