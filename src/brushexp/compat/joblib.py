"""Private parts of Hydra's joblib launcher that brushexp uses; tried with hydra-joblib-launcher 1.2.0."""

from typing import Any

from hydra.core.utils import JobReturn


def execute_job(number: int, words: list[str], *common: Any) -> JobReturn:
    """Run a job of a sweep in a process that knows nothing of Hydra yet.

    ``common`` are Hydra's context, the config of the sweep, the function of a job, and the state of the singletons.
    """
    from hydra_plugins.hydra_joblib_launcher._core import execute_job as execute  # noqa: PLC0415  (an extra)

    return execute(number, words, *common)
