"""Checks of the contracts of plugin families, which packages can apply to their own plugins.

    import brushexp
    import pytest
    from brushexp.registry import build_named

    @pytest.mark.parametrize("check", brushexp.testing.contract("engine"), ids=lambda check: check.__name__)
    def test_contract(check):
        check(lambda **options: build_named("engine", "dabs", options))

A check takes a function that builds the plugin from options, and fails with an AssertionError. The checks do not need
pytest; ``pytest.register_assert_rewrite("brushexp_testing")`` in a conftest.py makes their messages more detailed.
"""

from collections.abc import Callable
from typing import Any


def contract(family: str) -> list[Callable[..., Any]]:
    """List the checks for a plugin family; the last one checks the plugin's texts.

    >>> [check.__name__ for check in contract("order")]
    ['gives_every_stroke_a_depth', 'has_clear_texts']
    """
    from brushexp_testing import changes, engines, families, media, words  # noqa: PLC0415  (torch)

    checks = families.CHECKS | media.CHECKS | changes.CHECKS | {"engine": engines.CHECKS}
    return [*checks.get(family, []), words.has_clear_texts]
