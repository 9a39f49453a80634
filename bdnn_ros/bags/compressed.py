"""Files and messages that the recorder compressed with Zstandard."""

from __future__ import annotations

from pathlib import Path

from zstandard import ZstdDecompressor

SUFFIX = ".zstd"
"""What rosbag2 appends to the name of a file that it compressed as a whole."""
MAGIC = b"\x28\xb5\x2f\xfd"
"""What a Zstandard frame begins with."""
CHUNK = 1 << 20


def decompressed(part: Path, directory: Path) -> Path:
    """A decompressed copy of a file in a directory.

    Raises:
        EOFError: that was cut off.
        ZstdError: it is damaged.
    """
    place, frame = directory / part.stem, ZstdDecompressor().decompressobj()
    with part.open("rb") as source, place.open("wb") as target:
        while chunk := source.read(CHUNK):
            while chunk:
                if frame.eof:
                    frame = ZstdDecompressor().decompressobj()
                target.write(frame.decompress(chunk))
                chunk = frame.unused_data if frame.eof else b""
    if not frame.eof:
        raise EOFError("it ends before its content does")
    return place


def of_message(data: bytes) -> bytes:
    """A message, decompressed if necessary: no CDR message begins like Zstandard, so metadata.yaml is not needed."""
    return ZstdDecompressor().decompressobj().decompress(data) if data.startswith(MAGIC) else data
