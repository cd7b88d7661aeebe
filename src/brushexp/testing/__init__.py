"""The contract of each family of plugins, as checks that a package runs over its own.

    import pytest
    from brushexp.registry import build_named
    from brushexp.testing import contract

    @pytest.mark.parametrize("check", contract("engine"), ids=lambda check: check.__name__)
    def test_contract(check):
        check(lambda **options: build_named("engine", "dabs", options))

A check is given what builds the plugin, with options if it wants some, and fails with an AssertionError. It needs no
pytest; ``pytest.register_assert_rewrite("brushexp.testing")`` in a conftest.py makes it say more. brushexp's own tests
run the same checks over every plugin and preset that is registered.
"""

from brushexp.testing.checks import Check


def contract(family: str) -> list[Check]:
    """The checks of a family; none if its members are not alike in anything but their types.

    >>> [check.__name__ for check in contract("order")]
    ['gives_every_stroke_a_depth']
    """
    from brushexp.testing import engines, families  # noqa: PLC0415  (torch)

    return engines.CHECKS if family == "engine" else families.CHECKS.get(family, [])
