"""Identify files that are not readable pictures: raw photographs, films, vector drawings, documents."""

import importlib
import struct
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from brushexp.errors import UserError
from brushexp.pictures.tiff_directories import MAGIC, PHOTOMETRIC

# Raster formats only, because Pillow would start another program for EPS.
FORMATS = ("AVIF", "BMP", "DIB", "GIF", "JPEG", "JPEG2000", "MPO", "PNG", "PPM", "PSD", "QOI", "TGA", "TIFF", "WEBP")
WITH_CODECS = {"HEIF": "heic", "JXL": "jxl"}  # formats that need an extra
CURE = "convert it to a PNG or a JPEG"
HEAD = 4096  # bytes that identify a format
RAW_SUFFIXES = (
    *(".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dcr", ".dng", ".erf", ".fff", ".gpr", ".iiq", ".k25", ".kdc", ".mef"),
    *(".mos", ".mrw", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f"),
)
FILM_SUFFIXES = (
    *(".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".wmv", ".flv"),
    *(".ogv", ".3gp"),
)
RAW = "is a raw photograph; develop it (darktable, RawTherapee, Lightroom) and give the TIFF or JPEG"
FILM = "is a film, not a picture; save one of its frames as a PNG, or paint it as a film with image=..."
LIGHT = "has a high dynamic range; tone-map it (darktable, GIMP, pfstools) and give the PNG or JPEG"
PAGE = "is a page for print; convert it to pixels: pdftoppm -png -r 150 page.pdf page"
VECTOR = "is a vector drawing, not a picture of a known format; convert it to pixels (Inkscape, resvg) and give the PNG"
DAMAGED = "is damaged or cannot be decoded here; get the whole file, or convert it to a PNG or a JPEG"
UNKNOWN = f"is not a picture of a known format; {CURE}"
LAYERS = "is a file of a painting program; export it there as a PNG"
STARTS = {  # first bytes -> what the file is, and what to do
    b"\x76\x2f\x31\x01": LIGHT,
    b"#?RADIANCE": LIGHT,
    b"#?RGBE": LIGHT,
    b"PF\n": LIGHT,
    b"%PDF": PAGE,
    b"%!PS": PAGE,
    b"\xc5\xd0\xd3\xc6": PAGE,
    b"gimp xcf": LAYERS,
    b"FUJIFILMCCD-RAW": RAW,
    b"FOVb": RAW,
    b"\0MRM": RAW,
    b"II\xbc": f"is a JPEG XR, which is not supported; {CURE}",
    b"AT&TFORM": "is a DjVu document; convert it to pixels: ddjvu -format=tiff page.djvu page.tif",
    b"IIU\0": RAW,
    b"IIRO": RAW,
    b"IIRS": RAW,
    b"MMOR": RAW,
    b"II\x1a\0\0\0HEAP": RAW,
    b"\x1aE\xdf\xa3": FILM,
    b"OggS": FILM,
    b"FLV\1": FILM,
    b"\0\0\1\xba": FILM,
    b"0&\xb2u\x8ef\xcf\x11": FILM,
    b"version https://git-lfs": "is a Git LFS pointer to a picture; type git lfs pull",
    b"PK\3\4": "is an archive, or a file of a painting program; unpack it, or export a PNG",
}
PSD, PSB_VERSION = b"8BPS", 2
PSD_HEADER = struct.Struct(">4xH16xH")  # version and bits per channel
JPEG, JPEG_LS = b"\xff\xd8\xff", 0xF7  # first bytes; a marker
FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # JPEG markers that precede the size
LOSSLESS = (0xC3, 0xC7, 0xCB, 0xCF)
KNOWN = (  # first bytes of readable files, unless they are damaged
    *(b"\x89PNG", b"GIF8", b"qoif", b"\0\0\0\x0cjP  ", b"\xff\x4f\xff\x51", b"\0\0\0\x0cJXL ", *MAGIC),
)
HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")  # brands of ISO base media files
AVIF_BRANDS = (b"avif", b"avis")
CANON = b"CR"  # follows the first eight bytes of a raw TIFF
JXL_STARTS = (b"\xff\x0a", b"\0\0\0\x0cJXL \r\n\x87\n")
CODECS = {
    "heic": ("pillow_heif", "register_heif_opener"),
    "jxl": ("pillow_jxl", None),
}  # extra -> module, and the function that registers it
SENSOR = (32803, 34892)  # values of PHOTOMETRIC for sensor data
DNG_VERSION = 50706  # TIFF tag


def what_it_is(head: bytes) -> str:
    """Use the first bytes of a file that no decoder recognised to describe it, and say what the user can do."""
    tellers = (_by_start, _kind_of_psd, _kind_of_jpeg, _kind_of_container, _kind_of_text)
    words = (tell(head) for tell in tellers)
    return next(filter(None, words), UNKNOWN)


def is_special(words: str) -> bool:
    """Check whether `what_it_is` identified an unsupported file type, other than a film, rather than damage."""
    return words not in (DAMAGED, FILM, UNKNOWN)


def _by_start(head: bytes) -> str:
    return next((words for start, words in STARTS.items() if head.startswith(start)), "")


def _kind_of_container(head: bytes) -> str:
    """Determine whether a container file is a film, a raw photograph or a damaged picture."""
    if head[4:8] == b"ftyp":
        known = {b"crx ": RAW} | dict.fromkeys((*HEIF_BRANDS, *AVIF_BRANDS), DAMAGED)
        return known.get(head[8:12], FILM)
    if head[:4] == b"RIFF":
        return FILM if head[8:12] == b"AVI " else DAMAGED
    return DAMAGED if head.startswith(KNOWN) else ""


def _kind_of_text(head: bytes) -> str:
    text = head.lower()
    if b"<svg" in text:
        return VECTOR
    if b"<html" in text or b"<!doctype html" in text:
        return "is a web page and not the picture on it; save the picture itself"
    return ""


def _kind_of_psd(head: bytes) -> str:
    """Explain why a Photoshop file cannot be read, based on its header."""
    if not head.startswith(PSD):
        return ""
    if len(head) < PSD_HEADER.size:
        return DAMAGED
    version, depth = PSD_HEADER.unpack_from(head)
    if version == PSB_VERSION:
        return "is a PSB, Photoshop's large document; save it there as TIFF or PNG"
    if depth in (16, 32):
        return f"is a PSD of {depth} bits per colour; save it there with 8 bits (Image > Mode), or as TIFF or PNG"
    return DAMAGED


def _kind_of_jpeg(head: bytes) -> str:
    """Explain why a JPEG cannot be read, based on its frame header (ITU-T T.81, B.2.2)."""
    if not head.startswith(JPEG):
        return ""
    at = len(JPEG) - 1
    while at + 5 <= len(head) and head[at] == 0xFF:
        marker, length = head[at + 1], int.from_bytes(head[at + 2 : at + 4])
        if marker == JPEG_LS:
            return f"is a JPEG-LS, which is not supported; {CURE}"
        if marker in FRAMES:
            bits = head[at + 4]
            special = " without loss" if marker in LOSSLESS else f" of {bits} bits per colour" if bits != 8 else ""
            return f"is a JPEG{special}, which is not supported; {CURE}" if special else DAMAGED
        at += 2 + length
    return DAMAGED


def codec_for(head: bytes) -> str | None:
    """Return the extra needed to read a file with these first bytes; None if no extra is needed or known."""
    if head.startswith(JXL_STARTS):
        return "jxl"
    return "heic" if head[4:8] == b"ftyp" and head[8:12] in HEIF_BRANDS else None


@cache
def has_codec(extra: str) -> bool:
    """Register an extra's file format with Pillow; return False if the extra is not installed."""
    module, start = CODECS[extra]
    with suppress(ImportError):
        codec = importlib.import_module(module)
        if start is not None:
            getattr(codec, start)()
        return True
    return False


def check_not_raw(picture: Any, head: bytes = b"") -> None:
    """Raise a UserError if a Pillow image is only the thumbnail in a raw photograph."""
    if picture.format != "TIFF":
        return
    tags = picture.tag_v2
    named = is_raw(str(picture.filename)) or head[8:10] == CANON
    if named or DNG_VERSION in tags or tags.get(PHOTOMETRIC) in SENSOR:
        raise UserError(RAW)


def is_raw(path: str) -> bool:
    """Check whether a path has the suffix of a raw photograph."""
    return Path(path).suffix.lower() in RAW_SUFFIXES
