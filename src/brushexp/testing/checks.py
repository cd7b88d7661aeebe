"""What a check of a contract is."""

from collections.abc import Callable
from typing import Any

Make = Callable[..., Any]  # options -> a fresh plugin
Check = Callable[[Make], None]
