"""Test that Lightning's callbacks can be chosen by name."""

import pytest
from brushexp_integrations import lightning_callbacks as lightning
from test_callbacks import Line, fit

from brushexp.registry import plugins

LIGHTNINGS = [plugin for plugin in plugins("callbacks") if plugin.cls.__module__ == lightning.__name__]


@pytest.mark.parametrize("plugin", LIGHTNINGS, ids=lambda plugin: plugin.name)
def test_lightnings_callbacks_can_be_chosen(tmp_path, plugin):
    assert fit(tmp_path, Line(), chosen={plugin.name: {"_target_": plugin.target}}).global_step == 8
