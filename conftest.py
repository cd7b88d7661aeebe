"""Where tests begin. The process that deals them out to others needs nothing that takes seconds to import."""

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Know the fixtures where tests are run or listed; they bring these into the same order everywhere."""
    if config.option.dist == "no" or config.option.collectonly:
        config.pluginmanager.import_plugin("shared_fixtures")
    if getattr(config, "workerinput", {}).get("workerid") == "gw1":
        config.args.reverse()  # of two processes each compiles half of the tests, and loads what the other has compiled
