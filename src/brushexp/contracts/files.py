"""Read files with helpful errors, write files atomically, and show progress and text on terminals."""

from brushexp.system.checkpoint import CheckpointFormat, weights_hash
from brushexp.system.earlier import todays_settings
from brushexp.system.files import TEMPORARY, replacing, to_bytes, write_bytes, write_json, write_picture, write_text
from brushexp.system.hdf5 import (
    HDF5,
    check_chunk,
    dataset_of,
    encode_fixed,
    numbers_of,
    open_hdf5,
    text_of,
    whole_number_of,
)
from brushexp.system.progress import counting, showing, with_progress
from brushexp.system.published import catalogue_suffixes
from brushexp.system.reading import (
    check_file,
    check_format_version,
    check_plain,
    explaining,
    json_of,
    read_text,
    shorten_value,
    yaml_of,
)
from brushexp.system.run_files import CHECKPOINT, METRICS_FILE, note_files
from brushexp.system.spellings import find_path
from brushexp.system.terminal import IN_LOG, as_shown
from brushexp.system.words import SHIPPED, conf_folders

__all__ = [
    "CHECKPOINT",
    "HDF5",
    "IN_LOG",
    "METRICS_FILE",
    "SHIPPED",
    "TEMPORARY",
    "CheckpointFormat",
    "as_shown",
    "catalogue_suffixes",
    "check_chunk",
    "check_file",
    "check_format_version",
    "check_plain",
    "conf_folders",
    "counting",
    "dataset_of",
    "encode_fixed",
    "explaining",
    "find_path",
    "json_of",
    "note_files",
    "numbers_of",
    "open_hdf5",
    "read_text",
    "replacing",
    "shorten_value",
    "showing",
    "text_of",
    "to_bytes",
    "todays_settings",
    "weights_hash",
    "whole_number_of",
    "with_progress",
    "write_bytes",
    "write_json",
    "write_picture",
    "write_text",
    "yaml_of",
]
