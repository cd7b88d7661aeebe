"""A Hydra config source that also reads files with a byte order mark or in UTF-16.

Every program that uses Hydra imports this file, so it imports other modules only when a config is read.
"""

from io import StringIO
from pathlib import Path

from hydra._internal.core_plugins import file_config_source
from hydra.plugins.config_source import ConfigLoadError, ConfigResult
from omegaconf import OmegaConf


class TextConfigSource(file_config_source.FileConfigSource):
    """Reads configs from a folder such as ``text:///home/me/conf``; tested with Hydra 1.3.8 and 1.4.0rc3."""

    @staticmethod
    def scheme() -> str:
        return "text"

    def load_config(self, config_path: str) -> ConfigResult:
        from brushexp.system.reading import decode_text  # noqa: PLC0415

        path = Path(self.path, self._normalize_file_name(config_path))
        if not path.is_file():
            raise ConfigLoadError(f"Config not found : {path}")
        text = decode_text(path.read_bytes())
        header = self._get_header_dict(text)
        return ConfigResult(
            config=OmegaConf.load(StringIO(text)),
            path=f"{self.scheme()}://{self.path}",
            provider=self.provider,
            header=header,
        )
