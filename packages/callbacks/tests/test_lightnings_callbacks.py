"""Lightning's callbacks, by name."""

import pytest
from test_callbacks import Line, fit

from brushexp.registry import plugins


@pytest.mark.parametrize("plugin", plugins("callbacks"), ids=lambda plugin: plugin.name)
def test_lightnings_callbacks_can_be_chosen(tmp_path, plugin):
    assert fit(tmp_path, Line(), chosen={plugin.name: {"_target_": plugin.target}}).global_step == 8
